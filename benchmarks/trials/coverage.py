"""Trial of intervals and verdicts at the edges of the law of a count: clipped, rounded, hit and unpolarized pixels.

Frames are drawn here with numpy alone, from the definition of a count: photons, electrons of the readout, gain, whole
numbers, both ends of the range. Each case is measured, and its 68 and 95 % intervals are held against the light that
was drawn; `--verdicts` of the seeds are compared with the scene that they were drawn from, and with themselves.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from math import erfc
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from benchmarks.trials.harness import is_low_enough, over, scratch
from rigctl.errors import ConfigError, DataError
from rigctl.files.regions import Rectangle, Region
from rigctl.measure.measure import MeasuredRegion, measure
from rigctl.runs.folder import Run
from rigctl.runs.records import FrameRecord
from rigctl.verbs.compare import compare_run
from tests.rigctl.made_runs import at, make_run

Array = NDArray[np.float64]
SIDE, BORDER = 64, 4


@dataclass(frozen=True, kw_only=True)
class Case:
    """Light, camera and faults of a run; S0 in electrons, of which an angle has half."""

    s0_e: float = 4000.0
    dolp: float = 0.3
    aolp_deg: float = 20.0
    angles_deg: tuple[float, ...] = (0.0, 45.0, 90.0, 135.0)
    cycles: int = 3
    gain: float = 0.25
    read_e: float = 8.0
    black_dn: float = 64.0
    bits: int = 12
    texture: float = 0.0
    texture_px: float = 0.0
    noise_blur_px: float = 0.0
    is_heavy: bool = False  #: Noise of the readout follows Student's law of four degrees of freedom.
    drift: float = 0.0  #: Relative change of the light from the first frame to the last, 0 in their mean.
    wander: float = 0.0  #: Relative deviation of the light of each cycle.
    hit_share: float = 0.0
    hit_e: float = 2000.0


CASES: Mapping[str, Case] = {
    "plain": Case(),
    "one cycle": Case(cycles=1),
    "two cycles": Case(cycles=2),
    "textured": Case(texture=0.1, texture_px=3.0),
    "blurred noise": Case(noise_blur_px=1.0),
    "t4 noise": Case(is_heavy=True, read_e=30.0),
    "20 electrons": Case(s0_e=20.0, read_e=2.0, gain=2.0, black_dn=100.0),
    "0/60/120": Case(angles_deg=(0.0, 60.0, 120.0)),
    "0/10/20/90": Case(angles_deg=(0.0, 10.0, 20.0, 90.0)),
    "drift 1 %": Case(drift=0.01, cycles=6),
    "wander 0.3 %": Case(wander=0.003, cycles=6),
    "unpolarized": Case(dolp=0.0),
    "unpolarized 0/60/120": Case(dolp=0.0, angles_deg=(0.0, 60.0, 120.0)),
    "unpolarized 0/10/20/90": Case(dolp=0.0, angles_deg=(0.0, 10.0, 20.0, 90.0)),
    "DoLP of its error": Case(dolp=3e-4),
    "DoLP of 3 errors": Case(dolp=9e-4),
    "clipped at 0": Case(s0_e=20.0, dolp=0.335, read_e=10.0, gain=1.0, black_dn=0.0, bits=8),
    "clipped, textured": Case(
        s0_e=20.0, dolp=0.335, read_e=10.0, gain=1.0, black_dn=0.0, bits=8, texture=0.1, texture_px=3.0
    ),
    "clipped, few electrons": Case(s0_e=14.0, dolp=0.3, read_e=2.0, gain=1.0, black_dn=0.0, bits=8),
    "near saturation": Case(s0_e=25850.0),
    "8 bits": Case(s0_e=8000.0, gain=0.014, read_e=20.0, black_dn=4.0, bits=8),
    "8 bits, noise 0.4": Case(s0_e=1500.0, gain=0.014, read_e=10.0, black_dn=4.0, bits=8),
    "8 bits, unpolarized": Case(s0_e=3000.0, dolp=0.0, gain=0.014, read_e=15.0, black_dn=4.0, bits=8),
    "8 bits, one cycle": Case(s0_e=3000.0, gain=0.014, read_e=15.0, black_dn=4.0, bits=8, cycles=1),
    "hit": Case(hit_share=0.01),
    "hit, two cycles": Case(hit_share=0.01, cycles=2),
    "hit, textured": Case(hit_share=0.01, texture=0.1, texture_px=3.0),
    "hit, one cycle": Case(hit_share=0.01, cycles=1),
}
# Name of a changed scene: factors of S0 and DoLP, and degrees of the axis, by which its frames differ from its file.
POWER = {"light +0.2 %": (1.002, 1.0, 0.0), "DoLP +1 %": (1.0, 1.01, 0.0), "axis +0.3 deg": (1.0, 1.0, 0.3)}


def stokes_e(case: Case) -> Array:
    """Return S0, S1, S2 in electrons."""
    twice = np.radians(2.0 * case.aolp_deg)
    return case.s0_e * np.array([1.0, case.dolp * np.cos(twice), case.dolp * np.sin(twice)])


def frames_of(case: Case, seed: int) -> list[list[NDArray[np.uint16]]]:
    """Return the counts of each cycle and angle."""
    draw = np.random.default_rng([seed, *repr(case).encode()])
    shape = (SIDE + 2 * BORDER,) * 2
    s0, s1, s2 = stokes_e(case)
    light = np.ones(shape)
    if case.texture:
        grain = draw.standard_normal(shape)
        grain = gaussian_filter(grain, case.texture_px / 2.0, mode="wrap") if case.texture_px else grain
        light += case.texture * grain / np.sqrt(np.mean(grain**2))
    frames, count = [], case.cycles * len(case.angles_deg)
    for cycle in range(case.cycles):
        wandered = 1.0 + case.wander * draw.standard_normal()
        of_cycle = []
        for place, angle in enumerate(np.radians(case.angles_deg)):
            time = (cycle * len(case.angles_deg) + place) / max(count - 1, 1) - 0.5
            passed = 0.5 * (s0 + s1 * np.cos(2.0 * angle) + s2 * np.sin(2.0 * angle))
            mean_e = passed * light * wandered * (1.0 + case.drift * time)
            electrons = draw.poisson(mean_e).astype(np.float64)
            noise = draw.standard_t(4.0, shape) / np.sqrt(2.0) if case.is_heavy else draw.standard_normal(shape)
            electrons += case.read_e * noise
            if case.noise_blur_px:
                off = gaussian_filter(electrons - mean_e, case.noise_blur_px, mode="wrap")
                electrons = mean_e + off * np.sqrt((np.mean(mean_e) + case.read_e**2) / np.mean(off**2))
            hit = draw.random(shape) < case.hit_share
            electrons[hit] += draw.exponential(case.hit_e, int(hit.sum()))
            counts = np.rint(case.gain * electrons + case.black_dn)
            of_cycle.append(np.clip(counts, 0, 2**case.bits - 1).astype(np.uint16))
        frames.append(of_cycle)
    return frames


def run_of(case: Case, frames: list[list[NDArray[np.uint16]]], path: Path) -> Run:
    """Return frames as a run."""
    known = {"bit_depth": case.bits, "saturation_dn": 2.0**case.bits - 1.0, "black_level_dn": case.black_dn}
    made = [
        (at(angle, cycle=cycle, exposure_s=0.01, **known), counts)
        for cycle, of_cycle in enumerate(frames)
        for angle, counts in zip(case.angles_deg, of_cycle, strict=True)
    ]
    return make_run(path, made)


@dataclass(frozen=True, kw_only=True)
class _Held(Run):
    """A run whose frames are in memory: writing and reading them takes longer than a measurement."""

    held: list[NDArray[np.uint16]]

    def counts(self, record: FrameRecord) -> NDArray[np.uint16]:
        return self.held[record.sequence]


@cache
def _written(case: Case) -> Run:
    with scratch() as folder:
        return run_of(case, frames_of(case, 0), folder / "run")


REGION = Region(name="paint", rectangle=Rectangle(x=BORDER, y=BORDER, width=SIDE, height=SIDE))
NUMBERS = ("s0", "s1", "s2", "dolp", "aolp_deg")


def covered(case: Case, seed: int) -> dict[str, tuple[float, bool, bool]] | str:
    """Return score, and whether the 68 and the 95 % interval hold the truth, of each number; or why there is none."""
    frames = [counts for of_cycle in frames_of(case, seed) for counts in of_cycle]
    written = _written(case)
    run = _Held(held=frames, **{one.name: getattr(written, one.name) for one in fields(written)})
    try:
        region = measure(run, regions=[REGION]).regions["paint"]
    except (ConfigError, DataError) as error:
        return str(error)
    return _held(case, region)


def _held(case: Case, region: MeasuredRegion) -> dict[str, tuple[float, bool, bool]]:
    truth = dict(zip(NUMBERS, (*(case.gain * stokes_e(case)), case.dolp, case.aolp_deg), strict=True))
    found = {}
    for name, true in truth.items():
        sample = region.quantities.get(name, {}).get("mean")
        if sample is None or (name == "aolp_deg" and case.dolp == 0.0):
            continue
        off = sample.value - true
        off = (off + 90.0) % 180.0 - 90.0 if name == "aolp_deg" else off
        limits = getattr(sample, "intervals", None) or tuple(
            (sample.value - k * sample.std_error, sample.value + k * sample.std_error) for k in (1.0, 1.959964)
        )
        held = [low - sample.value <= -off <= high - sample.value for low, high in limits]
        found[name] = (off / sample.std_error if sample.std_error else 0.0, held[0], held[1])
    return found


def scene_text(case: Case) -> str:
    """Return a scene file of this light: one effective wavelength, S0 as radiance by the camera equation with pi."""
    photon_j = 6.62607015e-34 * 299792458.0 / 550e-9
    electrons_per_radiance = np.pi / 17.0 * (8.3e-6) ** 2 * 0.01 * 0.9 * 0.45 / photon_j
    radiance = (stokes_e(case) / electrons_per_radiance).tolist()
    texture = f"texture_rms = {case.texture}\n" if case.texture else ""
    return f"""name = "coverage"
[sensor]
pixel_pitch_um = 8.3
f_number = 2.0
optics_transmittance = 0.9
quantum_efficiency = 0.45
wavelength_nm = 550.0
bit_depth = {case.bits}
polarizer_transmittance = 1.0
extinction_ratio = 1e12
[noise]
gain_dn_per_e = {case.gain}
read_noise_e = {case.read_e}
dark_current_e_per_s = 0.0
black_level_dn = {case.black_dn}
prnu = 0.0
dsnu_e = 0.0
[acquisition]
exposure_ms = 10.0
[[regions]]
name = "paint"
rectangle = {{ x = {BORDER}, y = {BORDER}, width = {SIDE}, height = {SIDE} }}
stokes_radiance = {radiance}
{texture}"""


def noise_text(case: Case) -> str:
    """Return an exact noise calibration of this camera."""

    def exact(value: float) -> dict[str, float]:
        return {"value": value, "std_error": 1e-6 * value + 1e-9, "n": 10}

    return json.dumps(
        {
            "schema_version": 2,
            "kind": "noise",
            "gain_dn_per_e": exact(case.gain),
            "read_noise_e": exact(case.read_e),
            "dark_current_e_per_s": exact(0.0),
            "black_level_dn": exact(case.black_dn),
            "saturation_e": None,
            "prnu": exact(0.0),
            "dsnu_e": exact(0.0),
        }
    )


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a comparison said."""

    verdict: str
    p_value: float | None  #: Family-wise: the smallest alpha at which it disagrees.
    z: Mapping[str, float]  #: Of each row that was tested.
    flags: tuple[str, ...]


def judged(case: Case, seed: int, *, drawn: Case | None = None) -> dict[str, Verdict]:
    """Compare a run, drawn from another case if one is given, with the scene of a case, and with itself."""
    with scratch() as folder:
        run_of(drawn or case, frames_of(drawn or case, seed), folder / "run")
        (folder / "scene.toml").write_text(scene_text(case))
        (folder / "noise.json").write_text(noise_text(case))
        found = {}
        for kind, of in (("scene", {"scene": folder / "scene.toml"}), ("itself", {"regions": [REGION]})):
            if drawn is not None and kind == "itself":
                continue
            try:
                made = compare_run(folder / "run", noise=folder / "noise.json", calibrations="none", alpha=1e-3, **of)
            except (ConfigError, DataError) as error:
                found[kind] = Verdict(verdict=f"refused: {error}", p_value=None, z={}, flags=())
                continue
            rows = [row for row in made.rows if row.agrees is not None]
            z = {f"{row.quantity} {row.statistic}": float(row.z or 0.0) for row in rows}
            tails = two_sided(np.array(list(z.values())))
            p = float(min(1.0, tails.size * tails.min())) if tails.size else None
            flags = tuple(check.name for check in made.checks if check.verdict in ("flagged", "refused"))
            found[kind] = Verdict(verdict=made.verdict, p_value=p, z=z, flags=flags)
    return found


def two_sided(z: Array) -> Array:
    """Return the chance of a normal number at least as far from 0."""
    return np.array([erfc(abs(one) / np.sqrt(2.0)) for one in z])


ALPHAS = (0.05, 1e-3)


def run_coverage(*cases: str, seeds: int = 1000, first_seed: int = 0, verdicts: int = 200) -> bool:
    """Measure runs of each case, or of the named ones; compare the first `verdicts` of them with their scene."""
    sound = True
    for name in cases or CASES:
        case, every = CASES[name], range(first_seed, first_seed + seeds)
        sound &= _report_coverage(name, list(over(partial(covered, case), every, chunk=5)))
        if verdicts:
            sound &= _report_verdicts(name, list(over(partial(judged, case), every[:verdicts])))
    plain = CASES["plain"]
    for name, (light, degree, turn) in POWER.items() if verdicts and not cases else ():
        drawn = replace(plain, s0_e=plain.s0_e * light, dolp=plain.dolp * degree, aolp_deg=plain.aolp_deg + turn)
        made = list(over(partial(judged, plain, drawn=drawn), range(first_seed, first_seed + 40)))
        disagree = sum(verdicts["scene"].verdict == "disagrees" for verdicts in made)
        print(f"{name}: found in {disagree} of {len(made)}", flush=True)
        sound &= disagree == len(made)
    return sound


def _report_coverage(name: str, tried: list[dict[str, tuple[float, bool, bool]] | str]) -> bool:
    """Print coverage; three binomial errors below, or six per cent and three errors above, is a fault."""
    refused = [one for one in tried if isinstance(one, str)]
    if refused:
        print(f"{name:24} refused {len(refused)}: {refused[0][:150]}", flush=True)
    of_number: dict[str, list[tuple[float, bool, bool]]] = defaultdict(list)
    for one in tried:
        if not isinstance(one, str):
            for number, found in one.items():
                of_number[number].append(found)
    sound = True
    for number, found in of_number.items():
        z, narrow, wide = (np.array(column, dtype=np.float64) for column in zip(*found, strict=True))
        shares = narrow.mean(), wide.mean()
        is_off = ""
        for share, nominal in zip(shares, (0.6827, 0.95), strict=True):
            error = np.sqrt(nominal * (1.0 - nominal) / z.size)
            is_off += "  too narrow" if share < nominal - 3.0 * error else ""
            is_off += "  too wide" if share > nominal + 0.06 + 3.0 * error else ""
        print(
            f"{name:24} {number:8} n {z.size:4d}  {shares[0]:6.1%} {shares[1]:6.1%}  z {z.mean():+.2f} "
            f"var {z.var():.2f}{is_off}",
            flush=True,
        )
        sound &= not is_off
    return sound


def _report_verdicts(name: str, tried: list[dict[str, Verdict]]) -> bool:
    """Print how often sound runs disagree, and the rows whose scores are not standard normal."""
    sound = True
    for kind in tried[0]:
        made = [one[kind] for one in tried]
        said = Counter(one.verdict[:110] for one in made)
        flags = Counter(flag for one in made for flag in one.flags)
        off = [sum(one.p_value is not None and one.p_value <= alpha for one in made) for alpha in ALPHAS]
        judged_runs = [one for one in made if one.verdict != "cannot_be_judged" and one.p_value is not None]
        are_rare = all(is_low_enough(count, len(made), alpha) for count, alpha in zip(off, ALPHAS, strict=True))
        is_off = bool(judged_runs) and not are_rare
        rows = defaultdict(list)
        for one in judged_runs:
            for row, z in one.z.items():
                rows[row].append(z)
        odd = [
            f"{row} ({np.mean(z):+.2f}, {np.var(z):.2f})"
            for row, z in rows.items()
            if len(z) > 9
            and (abs(np.mean(z)) * np.sqrt(len(z)) > 4.0 or abs(np.var(z) - 1.0) > 4.0 * np.sqrt(2.0 / len(z)))
        ]
        print(
            f"{name:24} {kind:8} {dict(said)}; disagree {off[0]} at 0.05, {off[1]} at 0.001"
            f"{'  TOO OFTEN' if is_off else ''}; flags {dict(flags)}; off (mean, var): {', '.join(odd) or 'none'}",
            flush=True,
        )
        sound &= not is_off
    return sound
