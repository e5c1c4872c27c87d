"""`rigctl sky`: the polarized sky of a scene, with its own aerosol or with each kind."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rigctl.console import Json, note, solving_shown
from rigctl.files.choices import Engine
from rigctl.verbs.options import FilePath, Files, Part, Result, ScenePath, Writes, scene_file_of

if TYPE_CHECKING:
    from rigctl.scene.sky_map import SkyMap

_FILES = ("sky.png", "sky.json", "sky-aerosols.png", "sky-aerosols.json")


def sky(
    scene: ScenePath,
    /,
    *,
    engine: Engine = "own",
    compare_aerosols: bool = False,
    out: Annotated[FilePath | None, Writes(kind="folder", names=_FILES)] = None,
) -> "SkyResult":
    """Compute the sky of a scene: S0, S1, S2 and DoLP over the hemisphere, with the sun marked ([MK14] Fig. 2).

    The answer states the method and its accuracy, the optical depth, and the least known input. Computed skies are kept
    in the user's cache folder.

    Example: rigctl sky examples/scene-airborne.toml --out sky

    Example: rigctl sky examples/scene-airborne.toml --compare-aerosols --out sky

    Parameters
    ----------
    scene : path or SceneFile
        Scene file with [sun], [atmosphere] and the sensor's band.
    engine : {"own", "sasktran2"}
        Radiative transfer solver: own, or sasktran2 as an independent check.
    compare_aerosols : bool
        Compute the sky for each kind of aerosol, side by side.
    out : path
        Folder for sky.png and sky.json, or sky-aerosols.png and sky-aerosols.json.

    Returns
    -------
    SkyResult
        Stokes radiance over the hemisphere.

    Raises
    ------
    ConfigError
        The file states no sun and atmosphere, the sun is too low, or the engine is not installed.
    """
    from rigctl.scene.scene import scene_of_file
    from rigctl.scene.sky_map import skies_of_kinds, sky_map

    record, kinds = scene_of_file(scene_file_of(scene)), dict[str, "SkyMap"]()
    if compare_aerosols:
        for label, sky in skies_of_kinds(record, engine=engine):
            note(f"{label}: computed")
            kinds[label] = sky
        found = SkyResult(sky=next(iter(kinds.values())), kinds=kinds)
    else:
        with solving_shown() as tell:
            found = SkyResult(sky=sky_map(record, engine=engine, tell=tell))
    if out is not None:
        note(f"written: {' and '.join(found.write(Path(out)))} in {out}", below=True)
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class SkyResult(Result):
    """The sky of a scene as arrays; if requested for each kind of aerosol, the scene file's own first."""

    sky: "SkyMap"
    kinds: "dict[str, SkyMap]" = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<sky of {self.sky.name}, sun at zenith {self.sky.sun_zenith_deg:.1f} deg>"

    @property
    def zenith_deg(self) -> Any:
        """Zenith angles of the directions, (Z,) array [deg]."""
        return self.sky.zenith_deg

    @property
    def azimuth_deg(self) -> Any:
        """Azimuths of the directions, (A,) array, clockwise from north [deg]."""
        return self.sky.azimuth_deg

    @property
    def stokes(self) -> Any:
        """S0, S1, S2 in the frame of each direction, (Z, A, 3) array [W m-2 sr-1 in band]."""
        return self.sky.stokes

    @property
    def dolp(self) -> Any:
        """Degree of linear polarization, (Z, A) array."""
        return self.sky.dolp

    def content(self) -> Iterable[Part]:
        """Return sun, irradiance and largest DoLP, or a table of the kinds of aerosol."""
        from rigctl.report.light import kinds_picture, kinds_table, sky_lines, sky_picture
        from rigctl.scene.sky_map import sky_difference

        lines = sky_lines(self.sky)
        if self.kinds:
            most = max(sky_difference(sky, self.sky)["largest_dolp"] for sky in self.kinds.values())
            yield f"the kind of aerosol moves the DoLP of the sky by up to {most:.3f}"
            yield kinds_table(self.kinds)
            yield from (lines[0], *self.sky.remarks[:1])
            yield lambda: kinds_picture(self.kinds)
        else:
            yield from lines
            yield lambda: sky_picture(self.sky)

    def as_json(self) -> dict[str, Json]:
        """Return the content of sky.json or sky-aerosols.json."""
        from rigctl.report.light import kinds_json, sky_json

        return kinds_json(self.kinds) if self.kinds else sky_json(self.sky)

    def output_files(self) -> Files:
        """Return picture and numbers."""
        from rigctl.report.light import kinds_picture, sky_picture

        name = "sky-aerosols" if self.kinds else "sky"
        picture = kinds_picture(self.kinds) if self.kinds else sky_picture(self.sky)
        return {f"{name}.png": picture, f"{name}.json": self.as_json()}

    def to_xarray(self) -> Any:
        """Return s0, s1, s2 [W m-2 sr-1 in band] and dolp over zenith_deg and azimuth_deg as an `xarray.Dataset`."""
        from rigctl.report.document import optional

        places = ("zenith_deg", "azimuth_deg")
        unit = {"units": "W m-2 sr-1"}
        data: dict[str, Any] = {f"s{k}": (places, self.stokes[..., k], unit) for k in range(3)}
        data["dolp"] = (places, self.dolp, {"units": "1"})
        return optional("xarray").Dataset(data, coords={name: getattr(self, name) for name in places})
