"""What the page shows is what files and commands show."""

from importlib.resources import files
from pathlib import Path

from rigctl.report.drawing import colour_table
from rigctl.session.preparation import prepare_session
from rigctl.session.status import DarkSource, Estimate, LiveContent, RegionPolarization, live_lines
from tests.rigctl.example_files import EXAMPLES

STYLE = files("rigctl") / "data" / "web" / "style.css"


def test_the_scale_of_aolp_has_the_colours_of_files() -> None:
    (rule,) = (line for line in STYLE.read_text().splitlines() if line.startswith(".scale.aolp"))
    stops = [word.strip(" ,);}") for word in rule.split() if word.startswith("#")]
    table = colour_table("aolp")
    for k, stop in enumerate(stops):
        blue, green, red = table[round(255 * k / (len(stops) - 1))]
        assert abs(int(stop[1:3], 16) - int(red)) + abs(int(stop[3:5], 16) - int(green)) <= 12, stop
        assert abs(int(stop[5:7], 16) - int(blue)) <= 12, stop


def test_an_angle_that_may_be_any_is_undefined() -> None:
    def lines(sigma_deg: float | None) -> str:
        region = RegionPolarization(
            dolp=Estimate(value=0.01, sigma=0.01), aolp_deg=12.3, light_dn_per_s=1.0, aolp_sigma_deg=sigma_deg
        )
        dark = {"source": DarkSource.FRAMES, "mean_dn": 0.0}
        return "\n".join(live_lines(LiveContent(angles={}, regions={"panel": region}, drift=None, dark=dark)))

    assert "AoLP 12.3 deg" in lines(45.0)
    assert "AoLP undefined" in lines(46.0)
    assert "AoLP 12.3 deg" in lines(None)  # without a calibration nothing is known of its error


def test_drawn_regions_take_the_place_of_those_of_the_same_name(tmp_path: Path) -> None:
    region = '[[regions]]\nname = "{}"\nrectangle = {{ x = {}, y = 5, width = 9, height = 8 }}\n'
    session, drawn = tmp_path / "session.toml", tmp_path / "regions.toml"
    session.write_text((EXAMPLES / "session.toml").read_text() + region.format("own", 1) + region.format("both", 2))
    drawn.write_text(region.format("both", 3) + region.format("mine", 4))
    prepared = prepare_session(EXAMPLES / "rig-sim.toml", session, regions=drawn)
    assert [(one.name, one.rectangle.x) for one in prepared.session_file.regions if one.rectangle] == [
        ("both", 3),
        ("mine", 4),
        ("own", 1),
    ]
