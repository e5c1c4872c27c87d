"""Trial of `rigctl infer`: do posteriors hold drawn truths as often as they say, with the right model and a wrong one?

panels: radiances given; truths are drawn from the scene file, frames by numpy from the sensor equation, and measured.
roof: materials under a sky in two geometries; truth and discrepancy are drawn from their priors, and numbers of the
regions from the covariance of a run of 40 x 40 pixels a region.
wrong: as roof, but numbers are made by another diffuse term, and without a drawn discrepancy.

Ranks of the truths have to be uniform (chi-square of ten bins, p above 1e-3 divided by the number of inputs). Where the
model is wrong, 95 % intervals have to hold at least 90 % of the truths.
"""

import tempfile
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chisquare

from benchmarks.trials import uncertain_panels
from benchmarks.trials.harness import CHANCE, over
from model.processing.posterior import NotConvergedError, Problem, infer
from rigctl.comparison.inference import Evidence, gather_evidence, infer_inputs
from rigctl.errors import DataError
from rigctl.files.regions import Region
from rigctl.files.scene_file import load_scene
from rigctl.measure.diagnose import MeasuredRun, measure_run
from rigctl.runs.folder import Run
from rigctl.scene.scene import Scene, scene_of_file

Array = NDArray[np.float64]

PANEL_INPUTS = (
    "regions.black.stokes_radiance.0",
    "regions.black.stokes_radiance.1",
    "regions.white.stokes_radiance.0",
    "regions.grey.stokes_radiance.1",
    "rig.polarizer_offset_deg",
    "rig.exposure_ratio",
)
ROOF_INPUTS = (
    "regions.black.n",
    "regions.black.slope_rms",
    "regions.black.dhr",
    "regions.white.dhr",
    "regions.grey.slope_rms",
    "regions.grey.dhr",
)
WRONG_DIFFUSE = "polarised"


def roof_text(camera_azimuth_deg: float) -> str:
    """Return the scene of three painted panels, of the sizes of `uncertain_panels`, seen from an azimuth."""
    side = uncertain_panels.SIDE
    regions = "".join(
        f'[[regions]]\nname = "{name}"\nmaterial = "{material}"\n'
        f"rectangle = {{ x = {4 + (side + 8) * k}, y = 4, width = {side}, height = {side} }}\n"
        for k, (name, material) in enumerate((("black", "black-paint"), ("white", "white-paint"), ("grey", "asphalt")))
    )
    return f"""name = "painted panels"
[sun]
zenith_deg = 43.0
azimuth_deg = 106.0
day_of_year = 145
[geometry]
camera_zenith_deg = 53.0
camera_azimuth_deg = {camera_azimuth_deg}
[atmosphere]
tier = "fast"
visibility_km = {{ value = 23.0, std = 2.0 }}
[sensor]
pixel_pitch_um = 8.3
f_number = 2.0
optics_transmittance = 0.9
quantum_efficiency = {{ value = 0.45, std = 0.01 }}
band_nm = [540, 560]
bit_depth = 12
polarizer_transmittance = 0.8
extinction_ratio = 500
[noise]
gain_dn_per_e = 0.24
read_noise_e = 10.0
dark_current_e_per_s = 0.0
black_level_dn = 64.0
prnu = 0.01
dsnu_e = 0.0
[acquisition]
exposure_ms = 0.03
{regions}"""


def seen_run(run: Run, scene: Scene) -> MeasuredRun:
    """Return a run, measured in the regions of a scene."""
    regions = [Region(name=one.name, rectangle=one.given.rectangle) for one in scene.regions]
    return measure_run(run, regions)


def panels_draw(seed: int) -> dict[str, float]:
    """Return the rank of each truth of the panels."""
    draw = np.random.default_rng([seed, 1])
    truth = uncertain_panels.drawn_truth(draw)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.toml").write_text(uncertain_panels.scene_text())
        scene = scene_of_file(load_scene(Path(folder) / "scene.toml"))
        run = uncertain_panels.take_run(Path(folder) / "run", truth, draw)
        evidence = gather_evidence([seen_run(run, scene)], [scene], chosen=PANEL_INPUTS)
        found = infer_inputs(evidence, seed=seed).posterior
    true = np.array([truth[one.key] for one in evidence.parameters])
    shares = np.mean(found.inputs < true, axis=0)
    return {one.key: float(share) for one, share in zip(evidence.parameters, shares, strict=True)}


# Where the camera stands: toward the glint, beside it, and back [deg].
AZIMUTHS_DEG = (286.0, 16.0)


@cache
def roof_evidence(diffuse: str | None) -> Evidence:
    """Return the evidence of the roof, with a diffuse term in place of the scene's; its data are those of no light."""
    seen, scenes = [], []
    with tempfile.TemporaryDirectory() as folder:
        for place, azimuth in enumerate(AZIMUTHS_DEG):
            path = Path(folder) / f"scene-{place}.toml"
            path.write_text(roof_text(azimuth))
            file = load_scene(path)
            if diffuse is not None:
                file = file.model_copy(
                    update={"regions": tuple(one.model_copy(update={"diffuse": diffuse}) for one in file.regions)}
                )
            scene = scene_of_file(file)
            light = {key: number.value for key, number in uncertain_panels.STATED.items()}
            run = uncertain_panels.take_run(Path(folder) / f"run-{place}", light, np.random.default_rng(place))
            seen.append(seen_run(run, scene))
            scenes.append(scene)
        return gather_evidence(seen, scenes, chosen=ROOF_INPUTS)


def roof_draw(seed: int, *, is_wrong: bool) -> dict[str, float]:
    """Return the rank of each truth of the roof."""
    problem, draw = roof_evidence(None).problem, np.random.default_rng([seed, 2])
    made_by = roof_evidence(WRONG_DIFFUSE).problem if is_wrong else problem
    truth, numbers = _possible_truth(made_by, draw)
    scales = problem.scales(draw.standard_normal(2))
    cov = problem.noise_cov if is_wrong else problem.total_cov(scales)
    data = numbers + np.linalg.cholesky(cov) @ draw.standard_normal(numbers.size)
    found = infer(replace(problem, data=data), seed=seed)
    names = [one.key for one in roof_evidence(None).parameters] + (
        [] if is_wrong else ["scale of ln S0", "scale of DoLP"]
    )
    draws = np.concatenate([found.inputs, found.scales], axis=1)[:, : len(names)]
    shares = np.mean(draws < np.array([*truth, *scales])[: len(names)], axis=0)
    return dict(zip(names, shares.tolist(), strict=True))


def _possible_truth(problem: Problem, draw: np.random.Generator) -> tuple[Array, Array]:
    """Return inputs from the prior, and what the model makes of them; inputs that do not go together are drawn anew."""
    while True:
        u = draw.standard_normal(problem.mean.size)
        if problem.is_within(u):
            try:
                return problem.inputs(u), problem.model(problem.inputs(u))
            except ValueError:
                continue


CASES = {"panels": panels_draw, "roof": partial(roof_draw, is_wrong=False), "wrong": partial(roof_draw, is_wrong=True)}


def _drawn(case: str, seed: int) -> dict[str, float] | str:
    try:
        return CASES[case](seed)
    except (DataError, NotConvergedError) as error:
        return str(error)


def run_inference(*cases: str, draws: int = 200, first: int = 0) -> bool:
    """Infer the inputs of drawn truths in each case, or in the named ones."""
    roof_evidence(None), roof_evidence(WRONG_DIFFUSE)  # kept, and inherited by the workers
    good = True
    for case in cases or CASES:
        found = list(over(partial(_drawn, case), range(first, first + draws)))
        ranks = [answer for answer in found if isinstance(answer, dict)]
        refused = [answer for answer in found if isinstance(answer, str)]
        print(f"{case}: {len(ranks)} posteriors, {len(refused)} refused{'' if not refused else ': ' + refused[0]}")
        good &= len(refused) <= 0.02 * draws
        for name in ranks[0]:
            shares = np.array([of_draw[name] for of_draw in ranks])
            covered = float(np.mean((shares > 0.025) & (shares < 0.975)))
            p = float(chisquare(np.histogram(shares, bins=10, range=(0.0, 1.0))[0]).pvalue)
            good &= covered >= 0.9 if case == "wrong" else p > CHANCE / len(ranks[0])
            print(f"  {name:34} mean rank {shares.mean():.3f}, 95 % interval holds {covered:6.1%}, uniform p = {p:.2g}")
    return bool(good)
