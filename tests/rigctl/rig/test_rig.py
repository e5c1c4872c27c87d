"""How a stage of a rig file is opened."""

import json
from pathlib import Path

import pytest

from drivers.errors import NotConnectedError
from rigctl.errors import ConfigError, DataError
from rigctl.files.rig_file import StageSection, load_rig
from rigctl.rig.rig import open_stage
from tests.rigctl.example_files import EXAMPLES

FAMILIES = {"ellx": "ELL14", "zaber": "Zaber 50931", "apt": "K10CR1"}


def section(driver: str = "ellx", *, port: str | None = None, **more: object) -> StageSection:
    given = {"driver": driver, "port": port or f"sim:{driver}?speed=50"} | more
    return StageSection.model_validate(given)


@pytest.mark.parametrize("driver", list(FAMILIES))
def test_every_family_is_opened_by_its_entry_point_and_its_simulated_address(driver: str) -> None:
    with open_stage(section(driver), warn=pytest.fail) as stage:
        assert stage.identify().model == FAMILIES[driver]


def test_a_missing_driver_is_refused_with_the_installed_drivers() -> None:
    with (
        pytest.raises(ConfigError, match=r"no driver 'newport'; installed are: .*apt.*ellx.*zaber"),
        open_stage(section("newport", port="sim:ellx"), warn=pytest.fail),
    ):
        pass


def test_options_reach_the_driver() -> None:
    port = "sim:zaber?cycle=0&speed=50"
    with open_stage(section("zaber", port=port, options={"steps_per_turn": 24000}), warn=pytest.fail) as stage:
        assert stage.identify().serial_number == "114821"


def test_an_unknown_option_of_a_driver_is_refused_with_the_known_ones() -> None:
    with (
        pytest.raises(ConfigError, match=r"driver 'ellx' has no option colour; it takes address, tolerance_deg"),
        open_stage(section(options={"colour": 3}), warn=pytest.fail),
    ):
        pass


def test_another_stage_than_the_rig_files_is_refused() -> None:
    with (
        pytest.raises(NotConnectedError, match="serial number 11401326, and the rig file asks for 99"),
        open_stage(section(serial_number="99"), warn=pytest.fail),
    ):
        pass


def test_a_numbered_port_is_warned_about() -> None:
    warnings: list[str] = []
    with pytest.raises(NotConnectedError), open_stage(section(port="/dev/ttyUSB99"), warn=warnings.append):
        pass
    assert "/dev/ttyUSB99" in warnings[0]


def characterisation(tmp_path: Path, **changes: object) -> Path:
    content = {
        "schema_version": 1,
        "kind": "stage characterisation",
        "stage": {"model": "ELL14", "serial_number": "11401326", "firmware": "18"},
        "settle_s": 0.05,
        "is_settled": True,
    } | changes
    path = tmp_path / "stage.json"
    path.write_text(json.dumps(content))
    return path


def test_a_characterised_stage_is_given_the_time_to_settle(tmp_path: Path) -> None:
    with open_stage(section(characterisation=characterisation(tmp_path)), warn=pytest.fail) as stage:
        stage.home()
        assert stage.move_to(10.0).duration_s >= 0.05


def test_the_characterisation_of_another_stage_is_refused(tmp_path: Path) -> None:
    other = characterisation(tmp_path, stage={"model": "ELL14", "serial_number": "7", "firmware": "18"})
    with (
        pytest.raises(NotConnectedError, match="characterise it too"),
        open_stage(section(characterisation=other), warn=pytest.fail),
    ):
        pass


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"is_settled": False}, "not seen to rest"),
        ({"settle_s": -1}, "settle_s"),
        ({"kind": "noise"}, "kind"),
    ],
)
def test_a_characterisation_that_is_of_no_use_is_refused(
    tmp_path: Path, changes: dict[str, object], problem: str
) -> None:
    path = characterisation(tmp_path, **changes)
    with pytest.raises(DataError, match=problem), open_stage(section(characterisation=path), warn=pytest.fail):
        pass


def test_a_characterisation_is_sought_beside_the_rig_file(tmp_path: Path) -> None:
    text = (EXAMPLES / "rig-sim.toml").read_text()
    rig = tmp_path / "rig.toml"
    rig.write_text(text.replace("tolerance_deg", 'characterisation = "stage.json"\ntolerance_deg', 1))
    assert load_rig(rig).stage.characterisation == (tmp_path / "stage.json").resolve()
