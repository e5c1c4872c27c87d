"""A regions file that the program writes."""

from pathlib import Path

from rigctl.files.regions import Marker, Markers, Rectangle, Region, RegionsFile, regions_text
from rigctl.files.toml import load


def test_it_is_read_back_as_it_was(tmp_path: Path) -> None:
    square = [(0.25, 0.0), (9.0, 0.5), (9.125, 9.0), (0.0, 9.0)]
    file = RegionsFile(
        regions=[
            Region(name="a", rectangle=Rectangle(x=1, y=2, width=3, height=4), edge_px=2),
            Region(name="b.2", polygon=[(0.5, 1.0), (10.0, 1.0), (5.0, 7.25)]),
        ],
        markers=Markers(
            dictionary="5x5_100",
            seen=[Marker(id=0, corners=square), Marker(id=4, corners=square, regions=("a", "b.2"))],
        ),
    )
    path = tmp_path / "regions.toml"
    path.write_text(regions_text(file))
    assert load(path, RegionsFile) == file
