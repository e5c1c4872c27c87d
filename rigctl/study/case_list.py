"""The cases of a study: every combination, lists side by side, or draws from the laws of the numbers."""

import itertools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from rigctl.errors import ConfigError
from rigctl.files.study_file import MOST_CASES, CasesSection, VariedSection
from rigctl.scene.parameters import Parameter, get, require_within
from rigctl.scene.scene_record import Scene
from rigctl.study.study_case import Case

FloatArray = NDArray[np.float64]

# Levels of a Morris design, in shares of a law's probability: the middles of quarters. A step is two of them.
MORRIS_LEVELS = np.array([0.125, 0.375, 0.625, 0.875])
MORRIS_STEP = 0.5


def cases_of(section: CasesSection, scenes: Sequence[Scene]) -> tuple[Case, ...]:
    """Return every case of a study: those of the first scene, then those of the second, and so on.

    Parameters
    ----------
    section : CasesSection
        Which there are.
    scenes : sequence of Scene
        The scenes as their files have them.

    Raises
    ------
    ConfigError
        A scene has no such number, a listed value is outside its range, a law has no deviation, or there are too many
        cases; all problems at once.
    """
    parameters = [_parameters(section, scene) for scene in scenes]
    tables = [_values(section, scene, found) for scene, found in zip(scenes, parameters, strict=True)]
    rows = ((place, row) for place, table in enumerate(tables) for row in table)
    keys = tuple(section.parameters)
    return tuple(
        Case(number=number, scene=place, values=tuple(zip(keys, map(float, row), strict=True)))
        for number, (place, row) in enumerate(rows)
    )


def unit_draws(kind: str, inputs: int, n: int, seed: int) -> FloatArray:
    """Return draws in the unit cube, shape (cases, inputs); of sobol and morris in the order of their blocks.

    Notes
    -----
    Of "sobol" the rows are A, B, and for each input A with that input's column of B, n each (Saltelli et al., Comput.
    Phys. Commun. 181 (2010) 259). Of "morris" each of n paths has inputs + 1 points (Morris, Technometrics 33 (1991)
    161).
    """
    rng = np.random.default_rng(seed)
    if kind == "latin":
        return np.asarray(qmc.LatinHypercube(inputs, rng=rng).random(n))
    if kind == "sobol":
        both = np.asarray(qmc.Sobol(2 * inputs, scramble=True, rng=rng).random(n))
        first, second = both[:, :inputs], both[:, inputs:]
        mixed = [np.where(np.arange(inputs) == k, second, first) for k in range(inputs)]
        return np.concatenate([first, second, *mixed])
    if kind == "morris":
        return np.concatenate([_path(inputs, rng) for _ in range(n)])
    return rng.random((n, inputs))


def _path(inputs: int, rng: np.random.Generator) -> FloatArray:
    """One path of Morris: from a point on the levels each input steps once, in a random order, up or down."""
    points = [rng.choice(MORRIS_LEVELS, inputs)]
    for k in rng.permutation(inputs):
        point = points[-1].copy()
        point[k] += MORRIS_STEP if point[k] < MORRIS_STEP else -MORRIS_STEP
        points.append(point)
    return np.array(points)


def _parameters(section: CasesSection, scene: Scene) -> dict[str, Parameter]:
    found, problems = {}, []
    for key, varied in section.parameters.items():
        try:
            found[key] = get(scene, key)
            for value in varied.range or varied.steps:
                require_within(scene, {key: value}, option="cases.parameters")
            if varied.std == "stated" and found[key].std == 0.0:
                raise ConfigError(f'cases.parameters: {key}: std = "stated", and the scene states none')
        except ConfigError as error:
            problems.append(str(error))
    if problems:
        raise ConfigError(f"scene {scene.name}: " + "; ".join(problems))
    return found


def _values(section: CasesSection, scene: Scene, found: Mapping[str, Parameter]) -> Iterable[Sequence[float]]:
    varied = section.parameters
    steps = [one.steps for one in varied.values()]
    if section.kind == "grid":
        _require_few(int(np.prod([float(len(one)) for one in steps])))
        return itertools.product(*steps)
    if section.kind == "list":
        return zip(*steps, strict=True)
    n = section.n or 0
    _require_few(n * {"sobol": len(varied) + 2, "morris": len(varied) + 1}.get(section.kind, 1))
    cube = unit_draws(section.kind, len(varied), n, section.seed)
    if section.kind in ("random", "latin"):
        cube = _going_together(cube, section, scene)
    columns = [_at(one, found[key], cube[:, k]) for k, (key, one) in enumerate(varied.items())]
    rows: list[list[float]] = np.stack(columns, axis=1).tolist()
    return rows


def _going_together(cube: FloatArray, section: CasesSection, scene: Scene) -> FloatArray:
    """Return draws of numbers with their stated errors as those errors go together; all others stay independent."""
    places = {key: k for k, (key, one) in enumerate(section.parameters.items()) if one.std == "stated"}
    drawn = cube.copy()
    for joint in scene.joint_errors:
        chosen = [k for k, key in enumerate(joint.keys) if key in places]
        columns = [places[joint.keys[k]] for k in chosen]
        covariance = joint.covariance[np.ix_(chosen, chosen)]
        std = np.sqrt(np.diag(covariance))
        if len(chosen) > 1 and np.all(std > 0.0):
            variances, axes = np.linalg.eigh(covariance / np.outer(std, std))
            root = axes * np.sqrt(np.maximum(variances, 0.0)) @ axes.T
            scores = ndtri(np.maximum(cube[:, columns], np.finfo(np.float64).tiny))
            drawn[:, columns] = ndtr(scores @ root)
    return drawn


def _require_few(cases: int) -> None:
    if cases > MOST_CASES:
        raise ConfigError(f"cases: the study has {cases} cases of each scene, allowed is {MOST_CASES}")


def _at(varied: VariedSection, parameter: Parameter, share: FloatArray) -> FloatArray:
    """Return values of a law at shares of its probability; a normal law is cut at the number's limits."""
    if varied.steps:
        values = np.array(varied.steps, dtype=np.float64)
        return np.asarray(values[np.minimum((share * values.size).astype(int), values.size - 1)])
    if varied.range is not None:
        low, high = varied.range
        return np.asarray(low + (high - low) * share)
    std = parameter.std if varied.std == "stated" else float(varied.std or 0.0)
    ends = ndtr((np.array([parameter.least, parameter.most]) - parameter.value) / std)
    drawn = parameter.value + std * ndtri(ends[0] + share * (ends[1] - ends[0]))
    return np.asarray(np.clip(drawn, parameter.least, parameter.most))  # of the last digit alone
