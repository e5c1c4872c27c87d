"""What a person waits for: whole commands, and the first frame of a session."""

import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.timing import Row, command_s

_RIGCTL = (sys.executable, "-m", "rigctl")
_EXAMPLES = Path(__file__).parents[1] / "examples"
_EMPTY_FIGURE = (
    "import io; from matplotlib.figure import Figure; f = Figure(layout='constrained'); f.subplots(); "
    "f.savefig(io.BytesIO(), format='png')"
)
_STUDY = """
name = "view and exposure"
scenes = ["{scene}"]
quantities = ["dolp.mean", "s0.mean", "auc"]
[cases]
kind = "grid"
[cases.parameters]
"geometry.camera_zenith_deg" = {{ start = 10, stop = 60, n = 40 }}
"acquisition.exposure_ms" = {{ start = 0.02, stop = 0.04, n = 5 }}
"""
_CASES = 200


def rows() -> Iterator[Row]:
    """Time the commands of README, then predictions in number."""
    figure = command_s((sys.executable, "-c", _EMPTY_FIGURE))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        demo, out = folder / "demo", folder / "out"
        seconds = command_s((*_RIGCTL, "demo", "--out", str(demo)), runs=1)
        yield Row(work="`rigctl demo`", ours=seconds, beside="an empty figure", theirs=figure, most=6.0)
        scene = demo / "scene-panels.toml"
        for words, most in (
            (("predict", scene), 0.5),
            (("stokes", demo / "run", "--regions", demo / "regions.toml", "--out", out / "stokes"), 1.0),
            (("compare", demo / "run", scene, "--noise", demo / "noise.json", "--out", out / "compare"), 2.5),
        ):
            seconds = command_s((*_RIGCTL, *map(str, words)))
            yield Row(
                work=f"`rigctl {words[0]}` of the demo",
                ours=seconds,
                beside="an empty figure",
                theirs=figure,
                most=most,
            )
        yield Row(work="`acquire` to its first frame, on the clock", ours=_first_frame_s(demo, folder), most=1.0)
        yield from _predictions_in_number(folder)


def _first_frame_s(demo: Path, folder: Path) -> float:
    times = []
    for k in range(3):
        out, start_s = folder / f"first-{k}", time.perf_counter()
        words = (*_RIGCTL, "acquire", str(demo / "rig-sim.toml"), str(demo / "session.toml"), "--out", str(out))
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            while not any(out.glob("**/*.fits")) and process.poll() is None:
                time.sleep(0.005)
            times.append(time.perf_counter() - start_s)
            process.send_signal(signal.SIGINT)
            process.wait()
    return min(times)


def _predictions_in_number(folder: Path) -> Iterator[Row]:
    scene = _EXAMPLES / "scene-airborne.toml"
    zeniths = "geometry.camera_zenith_deg=10:60:100"
    seconds = command_s((*_RIGCTL, "sweep", str(scene), zeniths))
    yield Row(work="`sweep` of 100 airborne geometries, to 0.01", ours=seconds, most=2.0)
    file = folder / "study.toml"
    file.write_text(_STUDY.format(scene=scene), encoding="utf-8")
    seconds = command_s((*_RIGCTL, "study", str(file), "--workers", "1", "--out", str(folder / "study")), runs=1)
    yield Row(work=f"`study` of {_CASES} cases to 0.01, a case", ours=1e3 * seconds / _CASES, unit="ms", most=60.0)
