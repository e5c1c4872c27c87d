"""The focusing preview: its number, its picture, its page."""

import json
import socket
from contextlib import closing
from http.client import HTTPConnection
from importlib.resources import files
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from drivers.errors import DeviceError
from rigctl.cli import main
from rigctl.errors import ConfigError
from rigctl.verbs.preview import preview_on_page
from rigctl.web.pictures import brightness_of, middle, sharpness_of
from rigctl.web.rig import Task
from rigctl.web.server import Place

TASK = Task(kind="preview", exposure_ms=0.03)

# Squares of 8 pixels, half as bright again as what lies between.
SCENE = np.kron(np.indices((12, 16)).sum(axis=0) % 2, np.ones((8, 8))) * 500.0 + 1000.0


def counts_of(scene):
    return np.round(scene).astype(np.uint16)


def test_the_number_falls_the_further_the_lens_is_out_of_focus():
    blurred = [counts_of(cv2.GaussianBlur(SCENE, (0, 0), sigma)) for sigma in (0.5, 1.0, 2.0, 4.0)]
    sharpness = [sharpness_of(counts) for counts in blurred]
    assert sharpness == sorted(sharpness, reverse=True)
    assert sharpness[0] > 3.0 * sharpness[-1]


def test_the_number_does_not_change_with_the_exposure():
    one = sharpness_of(counts_of(SCENE))
    # Counts are whole: each is off by half of 500 at most, one in a thousand; slopes add it up twice, squares again.
    assert sharpness_of(counts_of(SCENE / 2.0)) == pytest.approx(one, rel=0.004)


def test_range_and_saturation_are_printed():
    counts = counts_of(SCENE)
    counts[:4] = 4095
    assert brightness_of(counts, bit_depth=12) == (1.0, 4 / 96)


def test_a_black_picture_has_no_sharpness():
    assert sharpness_of(np.zeros((8, 8), dtype=np.uint16)) == 0.0


@pytest.mark.parametrize("bit_depth", [8, 12, 16])
def test_a_picture_that_is_saturated_everywhere_has_no_sharpness(bit_depth):
    everywhere = np.full((582, 782), 2**bit_depth - 1, dtype=np.uint16)
    assert sharpness_of(everywhere) == 0.0


@pytest.mark.parametrize(("zoom", "shape"), [(1, (96, 128)), (4, (24, 32)), (64, (2, 2))])
def test_the_middle_is_shown_larger(zoom, shape):
    counts = counts_of(SCENE)
    part = middle(counts, zoom=zoom)
    assert part.shape == shape
    top, left = (96 - shape[0]) // 2, (128 - shape[1]) // 2
    assert part[0, 0] == counts[top, left]


def ask(address, path, content=None, *, token=None):
    place = urlsplit(address)
    token = place.query.removeprefix("token=") if token is None else token
    body = None if content is None else json.dumps(content)
    with closing(HTTPConnection(place.hostname, place.port, timeout=60.0)) as connection:
        connection.request(
            "GET" if body is None else "POST", path, body=body, headers={"Authorization": f"Bearer {token}"}
        )
        with connection.getresponse() as response:
            return response.status, response.read()


def test_it_is_the_page_of_serve_with_a_camera_alone():
    addresses = []
    task = Task(kind="preview", exposure_ms=0.03, zoom=4)
    with closing(preview_on_page("sim:gc780", task, Place(), opened=addresses.append)) as lines:
        assert next(lines).startswith("sharpness ")
        (address,) = addresses
        assert ask(address, "/")[1] == files("rigctl").joinpath("data", "web", "index.html").read_bytes()
        assert ask(address, "/api/state", token="guessed")[0] == 401
        state = json.loads(ask(address, "/api/state")[1])
        assert (state["title"], state["acts"], state["runs"]) == ("preview sim:gc780", ["task"], [])
        look = state["rig"]
        assert (look["left"], look["top"], look["width"], look["height"]) == (293, 218, 195, 145)
        assert ask(address, "/api/start", {"session": "any.toml"})[0] == 404
        assert ask(address, "/api/task", {"kind": "preview", "exposure_ms": 0.02})[0] == 200
        next(lines)
        assert json.loads(ask(address, "/api/state")[1])["rig"]["width"] == 782


def test_a_camera_that_cannot_be_opened_ends_the_page():
    with pytest.raises(DeviceError):
        next(preview_on_page("gige:nowhere.invalid", TASK, Place(), opened=str))


def test_so_many_pictures_are_numbered_on_a_page(capsys):
    words = ["preview", "sim:gc780", "--exposure-ms", "0.03", "--frames", "2", "--listen", "127.0.0.1:0"]
    assert main(words) == 0
    told = capsys.readouterr()
    assert "sharpness" in told.out
    assert "the picture is at http://127.0.0.1:" in told.err


def test_a_port_in_use_is_reported():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        place = Place(port=taken.getsockname()[1])
        pictures = preview_on_page("sim:gc780", TASK, place, opened=str)
        with pytest.raises(ConfigError, match="another port"):
            next(pictures)


def test_the_command_writes_pictures_and_numbers(tmp_path, capsys):
    picture = tmp_path / "p.jpg"
    arguments = ["preview", "sim:gc780", "--exposure-ms", "0.03", "--frames", "2", "--picture", str(picture)]
    assert main(arguments) == 0
    assert "sharpness" in capsys.readouterr().out
    assert cv2.imread(str(picture)).shape == (582, 782, 3)


@pytest.mark.parametrize("listen", ["8765", "127.0.0.1:x", "127.0.0.1:99999"])
def test_a_wrong_address_to_listen_at_is_refused(listen, capsys):
    assert main(["preview", "sim:gc780", "--listen", listen]) == 2
    assert "127.0.0.1:8765" in capsys.readouterr().err
