"""A posterior for people and programs: the answer, tables, JSON, pictures, draws, and the inferred materials."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rigctl.base.numbers import chance, finite, percent, plus_minus
from rigctl.comparison.inference import QUANTITIES, Inference
from rigctl.report.document import Column, Shown, Table, value_columns
from rigctl.report.drawing import MEASURED, PREDICTED, png, subplots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigctl.console import Json
    from rigctl.report.files import Content

    FloatArray = NDArray[np.float64]

# Least relative decrease of an input's standard deviation that counts as information.
_TAUGHT = 0.9
# p-value below which a region is not explained: one sound region in a thousand.
_UNEXPLAINED = 1e-3


def unexplained(found: Inference) -> tuple[str, ...]:
    """Return the regions that even the discrepancy does not explain."""
    return _missed(found, found.p_values)


def answer(found: Inference) -> str:
    """Return the information gained and whether the model explains the runs, in a sentence."""
    posterior = found.posterior
    taught = posterior.std < _TAUGHT * posterior.prior_std
    best = int(np.argmax(posterior.gain_bits))
    runs = "The run teaches" if len(found.evidence.runs) == 1 else f"The {len(found.evidence.runs)} runs teach"
    inputs = f"{runs} {int(taught.sum())} of {taught.size} inputs"
    parameter = found.evidence.parameters[best]
    most = (
        f"; most {parameter.key}: {_with_std(posterior.mean[best], posterior.std[best])} {parameter.unit}".rstrip()
        + f", before {_with_std(parameter.value, parameter.std)}"
    )
    return f"{inputs}{most if taught.any() else ''}. {_explained(found)}"


def _explained(found: Inference) -> str:
    lost = unexplained(found)
    if lost:
        return f"The posterior cannot be trusted: even its discrepancy does not explain {', '.join(lost)}."
    missed = _missed(found, found.p_values_of_model)
    if missed:
        return f"The model alone does not explain {', '.join(missed)}; its discrepancy widens the posterior."
    return "The model explains every region."


def _missed(found: Inference, p_values: FloatArray) -> tuple[str, ...]:
    return tuple(_place(found, int(k)) for k in np.flatnonzero(p_values < _UNEXPLAINED))


def doubts(found: Inference) -> Iterable[str]:
    """Return the inputs that cannot be distinguished, and those about which the runs have no information."""
    for group in found.indistinguishable:
        yield f"cannot be distinguished: {', '.join(group)}; only a combination of them is known"
    if found.evidence.untaught:
        yield f"not inferred, for lack of information in the runs: {', '.join(found.evidence.untaught)}"
    if found.posterior.impossible_share > 0.0:
        share = percent(found.posterior.impossible_share)
        yield f"the model does not exist at {share} of the checked draws, such as a dhr below the specular lobe"


def effort(found: Inference) -> str:
    """Return convergence of the chain and error of the emulator."""
    one = found.posterior
    return (
        f"converged: {one.steps / one.autocorrelation_steps:.0f} autocorrelation times of "
        f"{one.autocorrelation_steps:.0f} steps, R-hat {one.r_hat:.4f}; model computed at {one.model_calls} points, "
        f"its emulator is off by {one.emulator_error:.2f} standard deviations of the data"
    )


def inputs_table(found: Inference) -> Table[int]:
    """Return prior and posterior of each input, and the information gained."""
    posterior = found.posterior
    ends = np.quantile(posterior.inputs, (0.025, 0.975), axis=0)
    columns: tuple[Column[int], ...] = (
        Column(title="input", key="input", value=lambda k: found.evidence.parameters[k].key, left=True, unbroken=True),
        Column(key="unit", shown=Shown.PROGRAMS, value=lambda k: found.evidence.parameters[k].unit),
        Column(
            title="prior",
            text=lambda k: _with_std(found.evidence.parameters[k].value, found.evidence.parameters[k].std),
        ),
        Column(title="posterior", text=lambda k: _with_std(posterior.mean[k], posterior.std[k])),
        Column(key="prior_value", shown=Shown.PROGRAMS, value=lambda k: found.evidence.parameters[k].value),
        Column(key="prior_std", shown=Shown.PROGRAMS, value=lambda k: found.evidence.parameters[k].std),
        Column(key="mean", shown=Shown.PROGRAMS, value=lambda k: float(posterior.mean[k])),
        Column(key="std", shown=Shown.PROGRAMS, value=lambda k: float(posterior.std[k])),
        Column(key="from_95", shown=Shown.PROGRAMS, value=lambda k: float(ends[0, k])),
        Column(key="to_95", shown=Shown.PROGRAMS, value=lambda k: float(ends[1, k])),
        Column(
            title="bits",
            key="gain_bits",
            value=lambda k: float(posterior.gain_bits[k]),
            text=lambda k: f"{posterior.gain_bits[k]:.1f}",
        ),
    )
    title = "mean ± standard deviation; bits: information gained"
    return Table(title=title, columns=columns, rows=tuple(range(len(found.evidence.parameters))))


def regions_table(found: Inference) -> Table[int]:
    """Return p-values and discrepancy of the model for each region."""
    mean, std = found.discrepancy
    columns: tuple[Column[int], ...] = (
        Column(title="region", text=lambda k: _place(found, k), left=True, unbroken=True),
        Column(key="run", shown=Shown.PROGRAMS, value=lambda k: found.evidence.regions[k][0]),
        Column(key="region", shown=Shown.PROGRAMS, value=lambda k: found.evidence.regions[k][1]),
        *(
            Column[int](
                title=title,
                key=f"discrepancy_{name}",
                value=lambda k, q=q: float(mean[k, q]),  # type: ignore[misc]
                text=lambda k, q=q, f=factor: _with_std(f * mean[k, q], f * std[k, q]),  # type: ignore[misc]
            )
            for q, (name, title, factor) in enumerate(zip(QUANTITIES, _TITLES, (100.0, 1.0, 1.0), strict=True))
        ),
        Column(
            title="p model",
            key="p_value_of_model",
            value=lambda k: float(found.p_values_of_model[k]),
            text=lambda k: chance(found.p_values_of_model[k]),
        ),
        Column(
            title="p",
            key="p_value",
            value=lambda k: float(found.p_values[k]),
            text=lambda k: chance(found.p_values[k]),
        ),
    )
    title = "discrepancy of the model; p-value of the region's numbers for the model alone, and with its discrepancy"
    return Table(title=title, columns=columns, rows=tuple(range(len(found.evidence.regions))))


_TITLES = ("S0 [%]", "S1/S0", "S2/S0")


def _place(found: Inference, k: int) -> str:
    run, region = found.evidence.regions[k]
    return region if len(found.evidence.runs) == 1 else f"{run}: {region}"


def _with_std(value: float, std: float) -> str:
    return plus_minus(value, std)


def inference_json(found: Inference) -> dict[str, Json]:
    """Return all that was inferred as plain data."""
    posterior = found.posterior
    return {
        "schema_version": 1,
        "answer": answer(found),
        "runs": list(found.evidence.runs),
        "inputs": inputs_table(found).json(),
        "correlation": posterior.correlation.tolist(),
        "indistinguishable": [list(group) for group in found.indistinguishable],
        "not_inferred": list(found.evidence.untaught),
        "regions": regions_table(found).json(),
        "unexplained": list(unexplained(found)),
        "discrepancy_scales": {
            name: {"mean": float(draws.mean()), "from_95": float(low), "to_95": float(high)}
            for name, draws in zip(("ln_s0", "polarization"), posterior.scales.T, strict=False)
            for low, high in (np.quantile(draws, (0.025, 0.975)),)
        },
        "convergence": {
            "steps": posterior.steps,
            "autocorrelation_steps": posterior.autocorrelation_steps,
            "r_hat": finite(posterior.r_hat),
            "draws": len(posterior.inputs),
        },
        "emulator": {
            "model_calls": posterior.model_calls,
            "error_std": posterior.emulator_error,
            "impossible_share": posterior.impossible_share,
        },
        "remarks": list(found.evidence.remarks),
    }


def inference_files(found: Inference) -> dict[str, Content]:
    """Return numbers, pictures, draws and materials as files."""
    columns = value_columns(*(parameter.key for parameter in found.evidence.parameters))
    return {
        "posterior.json": inference_json(found),
        "posterior.csv": inputs_table(found),
        "draws.csv": Table(columns=columns, rows=tuple(found.posterior.inputs)),
        "corner.png": corner_png(found),
        "check.png": check_png(found),
        **_materials(found),
    }


def _materials(found: Inference) -> dict[str, bytes]:
    """Return a material file for each region with an inferred material."""
    from rigctl.files.materials import material_toml

    files = {}
    for region in found.evidence.scene.regions:
        names = {
            parameter.key.rpartition(".")[2]: k
            for k, parameter in enumerate(found.evidence.parameters)
            if parameter.key.startswith(f"regions.{region.name}.")
        }
        own = {name: k for name, k in names.items() if region.material is not None and hasattr(region.material, name)}
        if region.material is None or region.material.table is not None or not own:
            continue
        changed = {
            name: replace(
                getattr(region.material, name),
                values=(float(found.posterior.mean[k]),),
                wavelengths_m=(),
                standard_uncertainty=float(found.posterior.std[k]),
                source=f"inferred from {', '.join(found.evidence.runs)}",
                confidence="medium",
                assumed=False,
            )
            for name, k in own.items()
        }
        named = replace(region.material, name=f"{region.name}, inferred", **changed)
        files[f"{region.name}.toml"] = material_toml(named).encode()
    return files


def corner_png(found: Inference) -> bytes:
    """Return the marginal laws of all inputs, alone and in pairs, with their priors."""
    posterior, count = found.posterior, len(found.evidence.parameters)
    figure, axes = subplots(count, count, size=(1.2 + 1.7 * count, 1.0 + 1.6 * count))
    for place, ax in enumerate(axes):
        row, column = divmod(place, count)
        if column > row:
            ax.set_axis_off()
            continue
        draws = posterior.inputs[:, column]
        ax.set_xlim(*_span(draws))
        if column == row:
            ax.hist(draws, bins=40, density=True, histtype="step", color=MEASURED)
            at = np.linspace(*_span(draws), 100)
            parameter = found.evidence.parameters[column]
            score = (at - parameter.value) / parameter.std
            ax.plot(at, np.exp(-0.5 * score**2) / (math.sqrt(2.0 * math.pi) * parameter.std), "--", color=PREDICTED)
            ax.set_yticks([])
        else:
            ax.hexbin(draws, posterior.inputs[:, row], gridsize=30, mincnt=1, cmap="Greys", linewidths=0.1)
            ax.set_ylim(*_span(posterior.inputs[:, row]))
        ax.tick_params(labelsize=6)
        if row == count - 1:
            ax.set_xlabel(_label(found, column), fontsize=7)
        if column == 0 and row > 0:
            ax.set_ylabel(_label(found, row), fontsize=7)
    figure.suptitle("posterior (orange, grey) and prior (dashed)", fontsize=9)
    return png(figure)


def _span(draws: FloatArray) -> tuple[float, float]:
    low, high = (float(one) for one in np.quantile(draws, (0.001, 0.999)))
    margin = 0.1 * (high - low) or 1e-12
    return low - margin, high + margin


def _label(found: Inference, k: int) -> str:
    parameter = found.evidence.parameters[k]
    *over, last = parameter.key.split(".")
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    return f"{'.'.join(over)}\n{last}{unit}"


def check_png(found: Inference) -> bytes:
    """Return measured numbers of each region with the prediction of the posterior, with and without discrepancy."""
    posterior, problem = found.posterior, found.evidence.problem
    total = problem.total_cov(posterior.scales) + posterior.emulator_cov
    centre = posterior.modelled.mean(axis=0)
    alone = np.sqrt(posterior.modelled.var(axis=0) + np.diag(problem.noise_cov))
    whole = np.sqrt(posterior.modelled.var(axis=0) + np.diagonal(total, axis1=1, axis2=2).mean(axis=0))
    figure, axes = subplots(1, 3, size=(11.0, 1.2 + 0.35 * len(found.evidence.regions)))
    at = np.arange(len(found.evidence.regions))
    for k, (ax, title, factor) in enumerate(zip(axes, _TITLES, (100.0, 1.0, 1.0), strict=True)):
        own = 3 * at + k
        ax.errorbar(np.zeros(at.size), at, xerr=2.0 * factor * whole[own], fmt="none", color="0.75", elinewidth=7)
        ax.errorbar(np.zeros(at.size), at, xerr=2.0 * factor * alone[own], fmt="none", color=PREDICTED, elinewidth=3)
        ax.plot(factor * (problem.data - centre)[own], at, "o", color=MEASURED, markersize=5)
        ax.set_yticks(at, [_place(found, int(one)) for one in at] if k == 0 else [""] * at.size)
        ax.set_xlabel(f"{title}, measured less predicted")
        ax.invert_yaxis()
    figure.suptitle("measured (points); predicted, two standard deviations: by the model, grey with its discrepancy")
    return png(figure)
