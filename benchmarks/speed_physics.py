"""Accuracy against time of the physics: BRDF beside pySCATMECH and Mitsuba, sky beside sasktran2, laws beside draws."""

import importlib.util
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import cos, radians
from pathlib import Path

import numpy as np

from benchmarks.peers import answer, peer_python
from benchmarks.timing import Row, least_s
from model.atmosphere.air import AtmosphereState, column
from model.atmosphere.layers import AerosolKind
from model.atmosphere.solver import solve
from model.processing import dolp
from model.processing.detection import rx_roc
from model.processing.dolp_studies import rx_draws
from model.surface.pbrdf import Surface, mueller

_MS = 1e3
_WANTED_ERROR = 1e-4


def rows() -> Iterator[Row]:
    """Time what a prediction is made of, each at equal error beside its peer."""
    yield from _brdf()
    yield from _sky()
    yield _dolp()
    yield _roc()


def _brdf(count: int = 100_000) -> Iterator[Row]:
    rng = np.random.default_rng(2)
    theta_i, theta_r = rng.uniform(0.0, np.radians(85.0), (2, count))
    phi = rng.uniform(-np.pi, np.pi, count)
    surface = Surface(n=1.5, slope_rms=0.15)
    paint = replace(surface, dhr=0.8)

    def limit() -> None:
        # What the half-angle form begins and ends with.
        for _ in range(5):
            np.sin(phi), np.cos(phi)
        np.exp(-phi)
        np.empty((count, 9))[:] = 1.0

    lobe, whole, least = least_s(
        lambda: mueller(theta_i, theta_r, phi, surface=surface),
        lambda: mueller(theta_i, theta_r, phi, surface=paint),
        limit,
    )
    ns = 1e9 / count
    yield Row(
        work="BRDF of a geometry, lobe and diffuse", ours=ns * whole, unit="ns",
        beside="ten sines, one exponential", theirs=ns * least, most_ratio=2.0,
    )  # fmt: skip
    python = peer_python("pbrdf")
    if python is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        table, out = Path(folder) / "table.npz", Path(folder) / "out.npz"
        np.savez(table, theta_i=theta_i, theta_r=theta_r, phi=phi, n=1.5, slope_rms=0.15)
        program = Path(__file__).with_name("pbrdf_peer.py").read_text(encoding="utf-8")
        answer(python, program, str(table), str(out))
        found = dict(np.load(out))
    for name, shadowing in (("SCATMECH", "v-cavity"), ("Mitsuba", "smith")):
        if f"{name}_f" in found:
            own = mueller(theta_i, theta_r, phi, surface=replace(surface, shadowing=shadowing))
            apart = _largest_deviation(own, found[f"{name}_f"])
            yield Row(
                work=f"BRDF of a geometry, lobe; {apart:.0e} of F00 apart", ours=ns * lobe, unit="ns",
                beside=f"{name}, called from Python", theirs=1e9 / float(found[f"{name}_per_s"]), most_ratio=0.2,
            )  # fmt: skip


def _largest_deviation(own: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference of any element (or of F00, where the other has that alone) over F00."""
    intensity = own[:, 0, 0]
    mine = own if other.ndim == 3 else intensity
    shown = intensity > 1e-6  # below is the far tail of the lobe, which single precision does not hold
    difference = np.abs(mine - other).reshape(intensity.size, -1).max(axis=1)
    return float(np.max(difference[shown] / intensity[shown]))


def _sky() -> Iterator[Row]:
    """Time one wavelength of the sky in 171 directions, warm, by settings of equal error."""
    air, mu0 = column(AtmosphereState(visibility_m=23e3), wavelength_m=550e-9), cos(radians(50.0))
    zenith_rad, phi_rad = (
        grid.ravel() for grid in np.meshgrid(np.radians(np.arange(20, 81, 10)), np.radians(np.arange(0, 181, 10)))
    )
    # Beside the sun the aureole decides; nearer the zenith sasktran2 interpolates its source badly (1.6 %).
    away = np.cos(zenith_rad) * mu0 + np.sin(zenith_rad) * np.sin(radians(50.0)) * np.cos(phi_rad) < cos(radians(10.0))
    layers = air.layers(fine=True, aerosol=AerosolKind.POLARIZING)

    def ours(nodes: int) -> np.ndarray:
        solution = solve(layers, mu0=mu0, albedo=0.1, aerosol=AerosolKind.POLARIZING, nodes=nodes)
        return solution.stokes(solution.depth, np.cos(zenith_rad), phi_rad, looking="up")

    if importlib.util.find_spec("sasktran2") is None:
        (seconds,) = least_s(lambda: ours(8), rounds=3)
        yield Row(work="one wavelength of the sky, 16 streams", ours=_MS * seconds, unit="ms")
        return
    from model.atmosphere.sasktran2_engine import sasktran2_solution

    def theirs() -> np.ndarray:
        solution = sasktran2_solution(layers, mu0=mu0, albedo=0.1, aerosol=AerosolKind.POLARIZING)
        return solution.stokes(solution.depth, np.cos(zenith_rad), phi_rad, looking="up")

    def error(light: np.ndarray) -> float:
        return float(np.max((np.abs(light - truth) / truth[:, :1])[away]))

    truth, peer_error = ours(20), 0.0
    peer_error = error(theirs())
    nodes = next(nodes for nodes in (4, 5, 6, 8, 12, 16) if error(ours(nodes)) <= peer_error)
    own_s, peer_s = least_s(lambda: ours(nodes), theirs, rounds=3)
    yield Row(
        work=f"one wavelength of the sky to {peer_error:.0e} of S0, warm", ours=_MS * own_s, unit="ms",
        beside="sasktran2, 16 streams", theirs=_MS * peer_s, most_ratio=0.2,
    )  # fmt: skip


def _draws_for(work: Callable[[int], np.ndarray], truth: np.ndarray, draws: int, runs: int) -> float:
    """Return how many draws bring the rms error down to what is wanted, from what so many give."""
    errors = np.array([work(draws) - truth for _ in range(runs)])
    return draws * float(np.mean(errors**2)) / _WANTED_ERROR**2


def _dolp() -> Row:
    mean = np.array((1000.0, 24.0, 18.0))
    cov = np.array([[50.0, 20.0, 0.0], [20.0, 100.0, 60.0], [0.0, 60.0, 90.0]])
    rng, draws = np.random.default_rng(1), 100_000
    truth = dolp.moments(mean, cov, tolerance=1e-12)

    def drawn(count: int) -> np.ndarray:
        s0, s1, s2 = rng.multivariate_normal(mean, cov, count, method="cholesky").T
        values = np.hypot(s1, s2) / s0
        return np.array((values.mean() / truth.mean, values.std() / truth.std))

    needed = _draws_for(drawn, np.ones(2), draws, 20)
    own_s, drawn_s = least_s(lambda: dolp.moments(mean, cov, tolerance=_WANTED_ERROR), lambda: drawn(draws))
    return Row(
        work="mean and deviation of DoLP to 1e-4", ours=_MS * own_s, unit="ms",
        beside="drawing them to 1e-4", theirs=_MS * drawn_s * needed / draws, most_ratio=0.01,
    )  # fmt: skip


def _roc() -> Row:
    moments = (
        np.array([880.0, 44.0, 21.0]),
        np.array([[91.0, 4.4, 2.1], [4.4, 158.0, 0.0], [2.1, 0.0, 158.0]]),
        np.array([900.0, 30.0, -12.0]),
        np.array([[701.0, 2.4, -1.0], [2.4, 168.0, 0.0], [-1.0, 0.0, 168.0]]),
    )
    p, rng, draws = np.logspace(-3.0, np.log10(0.5), 200), np.random.default_rng(3), 100_000
    truth = rx_roc(p, *moments, tolerance=1e-12).p_detection

    def drawn(count: int) -> np.ndarray:
        return rx_draws(p, *moments, draws=count, generator=rng)[0]

    needed = _draws_for(drawn, truth, draws, 8)
    own_s, drawn_s = least_s(lambda: rx_roc(p, *moments, tolerance=_WANTED_ERROR), lambda: drawn(draws))
    return Row(
        work="ROC of 200 points to 1e-4", ours=_MS * own_s, unit="ms",
        beside="drawing it to 1e-4", theirs=_MS * drawn_s * needed / draws, most_ratio=0.01,
    )  # fmt: skip
