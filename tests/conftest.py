"""Options of the whole test suite."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--stage",
        metavar="ADDRESS",
        help="hold the contract suite over this rotation stage: DRIVER:PORT, such as ellx:/dev/serial/by-id/..., with "
        "?address=1&tolerance_deg=0.05 and the like behind it; or sim:... It will be homed and turned all the way",
    )
    parser.addoption(
        "--camera",
        metavar="ADDRESS",
        help="hold the contract suite over this camera: gige:192.168.0.5, v4l2:/dev/video0?pixel_format=Y12 and the "
        "like. It is exposed for 2 to 500 ms at a gain of 0 dB",
    )
