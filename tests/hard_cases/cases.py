"""The hard cases: scenes at the edges of what can be computed, each as what differs from a plain one."""

import re
from dataclasses import dataclass, field
from math import cos, sin
from typing import TypedDict, Unpack

from tests.rigctl.scene_texts import LIGHT, SENSOR

_RADIANCE = SENSOR.replace("band_nm = [400, 700]", "wavelength_nm = 550.0").replace(
    "f_number = 2.0", "f_number = { value = 2.0, std = 0.02 }"
)
_BAND = SENSOR.replace("f_number = 2.0", "f_number = { value = 2.0, std = 0.02 }").replace("[400, 700]", "[540, 560]")
_LIGHT = LIGHT.replace("wavelengths = 2", "wavelengths = 1")
_QUIET = (
    "[effects]\nwithout = ['shot-noise', 'quantisation', 'texture', 'read-noise', 'dark-current', 'non-uniformity']\n"
)
_BLACK = "rectangle = { x = 4, y = 4, width = 40, height = 40 }\n"
_PIXEL = "rectangle = { x = 24, y = 24, width = 1, height = 1 }\n"
_WHITE = "rectangle = { x = 52, y = 4, width = 40, height = 40 }\n"


@dataclass(frozen=True, kw_only=True)
class HardCase:
    """A scene with one thing at its edge.

    Attributes
    ----------
    name, text
        What is hard, and the scene file.
    surface
        Material file "surface.toml" beside the scene; empty for none.
    dolp
        DoLP of the target, from what the case states and by no formula of the program; None where none is known.
    condition
        By what the angles enlarge errors of rounding.
    """

    name: str
    text: str
    surface: str = ""
    dolp: float | None = None
    condition: float = 1.0


def _changed(text: str, **numbers: object) -> str:
    for name, value in numbers.items():
        text, count = re.subn(rf"(?m)^{name} = .*$", f"{name} = {value}", text)
        if count != 1:
            raise ValueError(f"{name}: stands {count} times in the scene")
    return text


@dataclass(frozen=True, kw_only=True)
class _Given:
    """Radiance of the target, which is polarized along 24 deg of (S1, S2); the background's stays."""

    s0: float = 8.0
    dolp: float = 0.4
    texture_rms: float = 0.01
    background: tuple[float, float, float] = (14.0, 1.9, -0.9)
    sensor: dict[str, object] = field(default_factory=dict)
    more: str = ""
    black: str = _BLACK

    def text(self) -> str:
        s1, s2 = (self.s0 * self.dolp * f(0.42) for f in (cos, sin))
        return (
            f'name = "hard"\n{_changed(_RADIANCE, **self.sensor)}{self.more}'
            f'[[regions]]\nname = "black"\n{self.black}stokes_radiance = [{self.s0}, {s1}, {s2}]\n'
            f"texture_rms = {self.texture_rms}\n"
            f'[[regions]]\nname = "white"\n{_WHITE}stokes_radiance = {list(self.background)}\ntexture_rms = 0.02\n'
        )


class _Changes(TypedDict, total=False):
    s0: float
    dolp: float
    texture_rms: float
    background: tuple[float, float, float]
    sensor: dict[str, object]
    more: str
    black: str


def _given(name: str, *, known: bool = True, condition: float = 1.0, **changes: Unpack[_Changes]) -> HardCase:
    given = _Given(**changes)
    return HardCase(name=name, text=given.text(), dolp=given.dolp if known else None, condition=condition)


def _lit(
    name: str,
    *,
    surface: str = "",
    more: str = "",
    extent: str = "",
    air: str = "visibility_km = 23.0",
    **numbers: object,
) -> HardCase:
    light = _LIGHT.replace("visibility_km = 23.0", air)
    material = "surface.toml" if surface else "black-paint"
    text = f'name = "hard"\n{_changed(_BAND + light, **numbers)}{more}'
    text += f'[[regions]]\nname = "black"\n{_BLACK}material = "{material}"\n{extent}'
    text += f'[[regions]]\nname = "white"\n{_WHITE}material = "asphalt"\ntexture_rms = 0.02\n'
    return HardCase(name=name, text=text, surface=surface)


def _surface(*, n: float = 1.5, k: float = 0.0, slope_rms: float = 0.2, dhr: float | None = 0.05) -> str:
    stated = "" if dhr is None else f"dhr = {dhr}\n"
    return f'name = "made"\nn = {n}\nk = {k}\nslope_rms = {slope_rms}\n{stated}'


_FIELD = "[field_of_view]\nwidth_deg = {0}\nheight_deg = {1}\n"

HARD_CASES: tuple[HardCase, ...] = (
    _given("plain: a radiance"),
    _given("DoLP 0", dolp=0.0),
    _given("DoLP 1e-6", dolp=1e-6),
    _given("DoLP 1", dolp=1.0),
    _given("S0 of 1e-3, SNR 0.1", s0=1e-3),
    _given("S0 of 1e-9, SNR 1e-7", s0=1e-9),
    _given("S0 of 0", s0=0.0, known=False),
    _given("DoLP above 1", dolp=1.1, known=False),
    _given(
        "SNR 1e6",
        texture_rms=0.0,
        sensor={"exposure_ms": 3e7, "gain_dn_per_e": 2e-10, "prnu": 0.0},
        more="[effects]\nwithout = ['quantisation', 'read-noise']\n",
    ),
    _given("extinction 1", sensor={"extinction_ratio": 1.0}),
    _given("extinction 1.000001", condition=2e6, sensor={"extinction_ratio": 1.000001}),
    _given("identical angles", sensor={"exposure_ms": "0.03\nangles_deg = [10, 10, 10, 10]"}),
    _given("angles 0, 180, 90", sensor={"exposure_ms": "0.03\nangles_deg = [0, 180, 90]"}),
    _given(
        "rank 3 barely: 0, 0.01, 0.02 deg", condition=3e8, sensor={"exposure_ms": "0.03\nangles_deg = [0, 0.01, 0.02]"}
    ),
    _given("two angles", sensor={"exposure_ms": "0.03\nangles_deg = [0, 45]"}),
    _given("repeated angles: 0, 0, 60, 60, 120", sensor={"exposure_ms": "0.03\nangles_deg = [0, 0, 60, 60, 120]"}),
    _given("angles 0, 10, 75, 100", sensor={"exposure_ms": "0.03\nangles_deg = [0, 10, 75, 100]"}),
    _given("zero noise", texture_rms=0.0, more=_QUIET),
    _given("texture alone: singular covariance", sensor={"read_noise_e": 0.0}, more=_QUIET.replace("'texture', ", "")),
    _given("20 electrons a frame", s0=0.117),
    _given(
        "DoLP with an SNR of 1e4",
        texture_rms=0.0,
        sensor={"exposure_ms": 8e3, "gain_dn_per_e": 8e-5, "prnu": 0.0, "bit_depth": 16},
    ),
    _given("clipped at zero: no black level", s0=0.05, sensor={"black_level_dn": 0.0}),
    _given("one angle of four saturated", s0=90.0),
    _given("saturated", s0=4000.0),
    _given("one pixel", black=_PIXEL),
    _given("background as the target", background=(8.0, 8.0 * 0.4 * cos(0.42), 8.0 * 0.4 * sin(0.42))),
    _given("tails of P_D: background 100 deviations away", background=(800.0, 10.0, 10.0), s0=1.0, texture_rms=1e-4),
    _given("texture of 1", texture_rms=1.0),
    _lit("plain: a material"),
    _lit("nadir, sun at the zenith", zenith_deg=0.0, camera_zenith_deg=0.0),
    _lit("retro-reflection", camera_azimuth_deg=180.0),
    _lit("view into the sun's glint, slopes 0.01", surface=_surface(slope_rms=0.01)),
    _lit("slopes 0.01, sideways", surface=_surface(slope_rms=0.01), camera_azimuth_deg=90.0),
    _lit("mirror: slopes 1e-3", surface=_surface(slope_rms=1e-3), camera_azimuth_deg=90.0),
    _lit("smoother than a mirror: slopes 1e-5", surface=_surface(slope_rms=1e-5)),
    _lit("slopes 2", surface=_surface(slope_rms=2.0)),
    _lit("view 80 deg", camera_zenith_deg=80.0),
    _lit("view 89 deg", camera_zenith_deg=89.0),
    _lit("view 89.9 deg", camera_zenith_deg=89.9),
    _lit("view 89.99 deg", camera_zenith_deg=89.99),
    _lit("view 90 deg", camera_zenith_deg=90.0),
    _lit("sun 85 deg", zenith_deg=85.0),
    _lit("sun 85.1 deg", zenith_deg=85.1),
    _lit("sun 90 deg", zenith_deg=90.0),
    _lit("sun 96 deg, below", zenith_deg=96.0),
    _lit("aerosol of depth 0", air="aerosol_optical_depth = 0.0"),
    _lit("aerosol of depth 3", air="aerosol_optical_depth = 3.0"),
    _lit("aerosol of depth 50", air="aerosol_optical_depth = 50.0"),
    _lit("ground albedo 1", air="visibility_km = 23.0\nground_albedo = 1.0"),
    _lit("camera on the ground", camera_height_m=0.0),
    _lit("camera 100 km up", camera_height_m=100000.0),
    _lit("field 1e-3 deg", more=_FIELD.format(1e-3, 1e-3), extent='extent = "field"\n'),
    _lit("field 60 x 40 deg", more=_FIELD.format(60, 40), extent='extent = "field"\n'),
    _lit("field 170 x 60 deg", more=_FIELD.format(169, 60), extent='extent = "field"\n', camera_zenith_deg=0.0),
    _lit(
        "sun in the field of view",
        more=_FIELD.format(60, 60),
        extent='extent = "field"\n',
        zenith_deg=85.0,
        camera_zenith_deg=85.0,
    ),
    _lit("field of the sun's glint", more=_FIELD.format(4, 4), extent='extent = "field"\n', surface=_surface()),
    _lit("index 1 + 1e-6", surface=_surface(n=1.000001)),
    _lit("index 1e9, the largest", surface=_surface(n=1e9, dhr=None)),
    _lit("index above the largest", surface=_surface(n=1e10, dhr=None)),
    _lit("absorption k = 1e9, the largest", surface=_surface(n=1.5, k=1e9, dhr=None)),
    _lit("index 0.3, below that of air", surface=_surface(n=0.3, dhr=None)),
    _lit("metal: index 0.2 + 3 i", surface=_surface(n=0.2, k=3.0, dhr=None)),
)

# Found by trial after the page was drawn up: each with the words of the command that it broke, and what it ends with.
MET_CASES: tuple[tuple[HardCase, str, int], ...] = (
    (_given("light without end: no noise is left beside that of light", s0=1e12), "effects SCENE --verify", 0),
    (_lit("visibility of 0.2 km, that no table has", air="visibility_km = 0.2"), "tradeoff SCENE --tolerances 0.1", 2),
    (
        _lit("Angstrom exponent of 10", air="visibility_km = 23.0\nangstrom_exponent = 10"),
        "tradeoff SCENE --tolerances 0.1",
        2,
    ),
    (
        _lit(
            "a field of a surface without light",
            surface=_surface(dhr=0.0) + "specular_weight = 0.0\n",
            more=_FIELD.format(1e-3, 1e-3),
            extent='extent = "field"\n',
        ),
        "effects SCENE --verify",
        0,
    ),
    (
        _given("texture alone under bright light that is hardly polarized", background=(8e5, 10.0, 10.0)),
        "predict SCENE --set noise.noise_factor=0",
        0,
    ),
    (
        _given("transmittance of 1 +- 0.1", sensor={"optics_transmittance": "{ value = 1.0, std = 0.1 }"}),
        "tradeoff SCENE --tolerances 0.1",
        0,
    ),
    (_given("pictures of laws without noise", texture_rms=0.0, more=_QUIET), "predict SCENE --out OUT", 0),
    (_lit("analytic sky", tier='"analytic"'), "predict SCENE --tolerance 0.1", 0),
)
