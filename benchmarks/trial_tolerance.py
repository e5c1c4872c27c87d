"""Trial of the tolerance: random scenes, predicted to a tolerance, beside the finest settings.

Usage: python -m benchmarks.trial_tolerance [--scenes 1000] [--first 0] [--tolerances 0.1 0.03 0.01 0.003]
    [--hostile] [--out FILE.csv]

Each scene is predicted to one of the tolerances in turn. Of every reading that is promised the true error must be no
more than the tolerance. Of each scene the largest estimated error is set beside the largest true one.
"""

import argparse
import csv
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from model.accuracy.evaluation.chain import evaluate
from model.accuracy.evaluation.quantities import Reading, Value, differences, readings
from model.accuracy.evaluation.settings import Settings
from model.accuracy.predict_to_tolerance import AccuratePrediction, predict
from model.atmosphere.lighting.fidelity import SolverSettings
from model.prediction.prediction import predict as predict_scenario
from model.scene.lit_scene import LitScene
from tests.model.accuracy.random_scenes import hostile_scene, random_scene

# Finer in every knob than a plan for the smallest of the tolerances, and with other layers than any plan has; the law
# of DoLP and the ROC by quadrature alone.
FINEST = Settings(
    wavelengths=8,
    split_at_kinks=True,
    solver=SolverSettings(
        fine_layers=True, nodes=16, element_depth=0.05, tolerance=1e-7, matrix_tolerance=1e-3, extrapolated=True
    ),
    sky_zeniths=36,
    sky_azimuths=32,
    hemisphere_tolerance=1e-5,
    tiles_per_side=12,
    negligible_spread=0.0,
    dolp_tolerance=1e-11,
    roc_tolerance=1e-11,
)
# The same for tolerances below 0.003.
_VERY_FINE = replace(
    FINEST,
    wavelengths=10,
    solver=replace(FINEST.solver, nodes=24, tolerance=1e-9),
    sky_zeniths=54,
    sky_azimuths=50,
    hemisphere_tolerance=1e-6,
    tiles_per_side=16,
)
_FINE_DOWN_TO = 0.003
_SMALLEST_TRUE = 1e-12


def main() -> int:
    """Run the trial; return 1 where a promise is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--tolerances", type=float, nargs="+", default=[0.1, 0.03, 0.01, 0.003])
    parser.add_argument("--hostile", action="store_true", help="tilted panels, other tiers, laws, sources and airs")
    parser.add_argument("--out", type=Path, default=None)
    arguments = parser.parse_args()
    kept = run_tolerance(
        arguments.scenes,
        arguments.tolerances,
        first=arguments.first,
        make_scene=hostile_scene if arguments.hostile else random_scene,
        out=arguments.out,
    )
    return 0 if kept else 1


def run_tolerance(
    scenes: int,
    tolerances: list[float],
    *,
    first: int = 0,
    make_scene: Callable[[int], LitScene] = random_scene,
    out: Path | None = None,
) -> bool:
    """Run the trial over a number of scenes; return whether every promise was kept."""
    rows = []
    for seed in range(first, first + scenes):
        rows.append({"seed": seed} | one_scene(make_scene(seed), tolerances[seed % len(tolerances)]))
        print(rows[-1], flush=True)
    if out is not None:
        with out.open("w", newline="") as file:
            writer = csv.DictWriter(file, fieldnames=list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    print(summary(rows))
    return not any(row["broken"] for row in rows)


def one_scene(scene: LitScene, tolerance: float) -> dict[str, Any]:
    """Return what came of one scene."""
    found = predict(scene, tolerance=tolerance)
    return {"tolerance": tolerance} | scored(found, truth(scene, found))


def truth(scene: LitScene, found: AccuratePrediction) -> dict[Reading, Value]:
    """Return the readings of the finest settings.

    Whether DoLP has moments depends on the tolerance of its law: those that have none to 1e-11 are taken with the
    prediction's own, from the light of the finest settings.
    """
    settings = FINEST if found.tolerance >= _FINE_DOWN_TO else _VERY_FINE
    finest = evaluate(scene, replace(settings, solver=replace(settings.solver, face_m=scene.sensor_height_m)))
    looser = predict_scenario(finest.scenario, tolerance=found.result.settings.dolp_tolerance)
    return readings(finest.scenario, looser, ()) | readings(finest.scenario, finest.predictions, finest.detections)


def scored(found: AccuratePrediction, finest: dict[Reading, Value]) -> dict[str, Any]:
    """Return the largest true and estimated error, and how many promises were broken."""
    own = readings(found.result.scenario, found.result.predictions, found.result.detections)
    true = differences(own, finest)
    promised = {key: error for key, error in true.items() if key not in found.not_guaranteed}
    broken = {key: error for key, error in promised.items() if error > found.tolerance}
    worst = max(promised, key=lambda key: promised[key], default=None)
    ratios = [found.budget.total[key] / error for key, error in promised.items() if error > _SMALLEST_TRUE]
    largest = max(promised.values(), default=0.0)
    estimated = max((found.budget.total[key] for key in promised), default=0.0)
    return {
        "broken": len(broken),
        "readings": len(true),
        "not_promised": len(true) - len(promised),
        "true": largest,
        "estimated": estimated,
        "ratio": estimated / largest if largest > _SMALLEST_TRUE else np.nan,
        "reading_median": float(np.median(ratios)) if ratios else np.nan,
        "reading_above_1": float(np.mean(np.array(ratios) >= 1.0)) if ratios else np.nan,
        "worst": "" if worst is None else "/".join(worst),
        "seconds": round(sum(found.stage_s.values()), 3),
    }


def summary(rows: list[dict[str, Any]]) -> str:
    """Return the verdict in words."""
    ratio = np.array([row["ratio"] for row in rows], dtype=np.float64)
    ratio = ratio[np.isfinite(ratio)]
    held = sum(row["broken"] == 0 for row in rows)
    share = sum(row["not_promised"] for row in rows) / max(sum(row["readings"] for row in rows), 1)
    return (
        f"{len(rows)} scenes: every promise kept in {held}; not promised {100 * share:.1f} % of the readings; "
        f"estimated/true of the largest error: above 1 in {100 * np.mean(ratio > 1.0):.1f} %, "
        f"median {np.median(ratio):.1f}, least {np.min(ratio):.2f}"
    )


if __name__ == "__main__":
    sys.exit(main())
