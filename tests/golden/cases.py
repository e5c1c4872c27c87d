"""The chapters: which commands are run, in which folder.

A renamed verb or option is one edit here. Names of chapters and commands stay: what is stored stands under them.
"""

from tests.golden import folders, functions
from tests.golden.harness import Chapter

_CLOCK = "--clock 2010-05-25T17:07Z"
_SCENES = {
    "airborne": "scene-airborne.toml",
    "panels": "scene-panels.toml",
    "panels-uncertain": "scene-panels-uncertain.toml",
    "roof": "scene-roof.toml",
    "rooftop-morning": "scene-rooftop-morning.toml",
    "rooftop-morning-by-time": "scene-rooftop-morning-by-time.toml",
    "rooftop-noon": "scene-rooftop-noon.toml",
    "rooftop-noon-by-time": "scene-rooftop-noon-by-time.toml",
    "paper-library": "paper/library.toml",
    "paper-rough": "paper/rough.toml",
    "effects-airborne": "effects/airborne.toml",
    "effects-bench": "effects/bench.toml",
    "effects-lamp": "effects/lamp.toml",
    "effects-roof-3m": "effects/roof-3m.toml",
    "effects-twilight": "effects/twilight.toml",
}

CHAPTERS = {
    "predictions": Chapter(
        prepare=folders.examples,
        commands={name: f"predict {scene} --json" for name, scene in _SCENES.items()}
        | {
            "with-files": "predict scene-panels.toml --out predicted --write-truth truth.toml --json",
            "uncertainty": "predict scene-panels-uncertain.toml --uncertainty --json",
            "set": "predict scene-panels.toml --set sensor.f_number=4 --set acquisition.exposure_ms=0.1 --json",
            "roc": "predict scene-panels.toml --roc black_panel,asphalt --snr both --out roc --json",
            "light": "predict scene-airborne.toml --light reflected_sun --json",
            "sweep": "sweep scene-panels.toml sensor.f_number=2:8:4 --out sweep --json",
            "grid": "sweep scene-panels.toml sensor.f_number=2:8:3 acquisition.exposure_ms=0.01:0.03:3 --json",
            "sky-sweep": "sweep scene-airborne.toml sun.zenith_deg=20:60:3 --json",
            "tolerance-0.1": "predict scene-airborne.toml --tolerance 0.1 --json",
            "tolerance-0.03": "predict scene-airborne.toml --tolerance 0.03 --json",
            "tolerance-0.01": "predict scene-airborne.toml --tolerance 0.01 --json",
            "tolerance-panels": "predict scene-panels.toml --tolerance 0.001 --json",
            "without": "predict effects/lamp.toml --tolerance 0.03 --without texture --json",
        },
    ),
    "models": Chapter(
        prepare=folders.examples,
        commands={
            "effects-panels": "effects scene-panels.toml --json",
            "effects-lamp": "effects effects/lamp.toml --tolerance 0.01 --json",
            "effects-bench": "effects effects/bench.toml --tolerance 0.03 --effects all --json",
            "effects-rig": "effects rig-effects.toml --json",
            "sky": "sky scene-airborne.toml --out sky --json",
            "surface-list": "surface --list --json",
            "surface": "surface black-paint --sun-zenith-deg 50 --out black-paint --json",
            "surface-own": "surface material-mine.toml --json",
            "dolp-estimators": "dolp estimators --json",
        },
    ),
    "panels": Chapter(
        prepare=folders.small_rig,
        commands={
            "plan": "plan rig-sim.toml session.toml --at 2026-05-04T10:00Z --json",
            "plan-rooftop": "plan rig-rooftop.toml session-rooftop.toml --at 2026-05-04T10:00Z --json",
            "acquire": f"acquire rig-sim.toml session.toml --out runs/panels {_CLOCK}",
            "again": f"acquire rig-sim.toml session.toml --out runs/panels {_CLOCK}",
            "status": "status runs/panels --json",
            "info": "status runs/panels --contents --json",
            "log": "status runs/panels --log --json",
            "verify": "verify runs/panels --json",
            "summary": "status runs/panels --page runs/panels-summary.html --json",
            "stokes": "stokes runs/panels --regions regions.toml --out stokes --json",
            "compare-regions": "compare runs/panels --regions regions.toml --out compared-regions --json",
            "compare": "compare runs/panels scene-panels.toml --out compared --json",
            "compare-free": "compare runs/panels scene-panels.toml --scale free --out compared-free --json",
            "compare-uncertain": "compare runs/panels scene-panels-uncertain.toml --out compared-uncertain --json",
            "detect": "detect runs/panels --background asphalt --target black_panel --regions regions.toml"
            " --out rx --json",
            "detect-scene": "detect runs/panels --background asphalt --target black_panel --scene scene-panels.toml"
            " --out rx-scene --json",
            "export-tiff": "export runs/panels --to tiff --out tiff",
            "export-hdf5": "export runs/panels --to hdf5 --out panels.h5",
            "bundle": "bundle runs/panels --out fault.zip",
            "note": 'note runs/panels "a cloud passed" --at 17:10 --by ann --json',
            "exclude": 'note runs/panels "a bird" --exclude 5,7-8 --by ann --json',
            "info-excluded": "status runs/panels --contents --json",
            "stokes-excluded": "stokes runs/panels --regions regions.toml --out stokes-excluded --json",
            "stokes-all": "stokes runs/panels --regions regions.toml --ignore-exclusions --out stokes-all --json",
            "stokes-again": "stokes runs/panels --regions regions.toml --out stokes-all --json",
        },
    ),
    "perturbed": Chapter(
        prepare=folders.perturbed_rig,
        commands={
            "many": f"acquire rig-sim.toml session-many.toml --out runs/many {_CLOCK}",
            "stokes-many": "stokes runs/many --regions regions.toml --correct throughput --out stokes-many --json",
            "compare-many": "compare runs/many scene-panels.toml --out compared-many --json",
            "turned": f"acquire rig-turned.toml session.toml --out runs/turned {_CLOCK}",
            "compare-turned": "compare runs/turned scene-panels.toml --out compared-turned --json",
            "weak": f"acquire rig-weak.toml session.toml --out runs/weak {_CLOCK}",
            "compare-weak": "compare runs/weak scene-panels.toml --out compared-weak --json",
            "mosaic": f"acquire rig-mosaic.toml session.toml --out runs/mosaic {_CLOCK}",
            "stokes-mosaic": "stokes runs/mosaic --regions regions.toml --out stokes-mosaic --json",
        },
    ),
    "calibrations": Chapter(
        prepare=folders.calibration_rig,
        relative={"lens": 1e-5},  # OpenCV sums in several threads
        commands={
            "noise-run": f"acquire rig-sim.toml session-noise.toml --out runs/noise {_CLOCK}",
            "noise": "calibrate noise --run runs/noise --out noise.json --report noise.html"
            " --defects defects.png --json",
            "flats-run": f"acquire rig-sim.toml session-flats.toml --out runs/flats {_CLOCK}",
            "flat": "calibrate flat runs/flats --out flat.npz --json",
            "axis-run-0": f"acquire rig-axis0.toml session-axis.toml --out runs/axis0 {_CLOCK}",
            "axis-run-30": f"acquire rig-axis30.toml session-axis.toml --out runs/axis30 {_CLOCK}",
            "axis": "calibrate axis runs/axis0 runs/axis30 --reference-deg 0 --reference-deg 30 --dolp 0.95"
            " --dolp-std 0.001 --regions light.toml --out polarizer.json --report axis.html --write rig-sim.toml"
            " --json",
            "walk": "import runs/walk walk0.png walk45.png walk90.png walk135.png --angles 0,45,90,135"
            " --exposure-s 0.01 --black-level-dn 0 --bit-depth 12",
            "registration": "calibrate registration runs/walk --out walk.json --json",
            "stokes-registered": "stokes runs/walk --register walk.json --out stokes-walk --json",
            "lens": "calibrate lens board0.png board1.png board2.png board3.png board4.png --board 7x5 --square-mm 30"
            " --out lens.json --json",
            "panels-run": f"acquire rig-sim.toml session.toml --noise noise.json --out runs/panels {_CLOCK}",
            "radiometric": "calibrate radiometric runs/panels --panel white_panel --scene scene-panels-uncertain.toml"
            " --noise noise.json --out radiometric.json --json",
            "stokes": "stokes runs/panels --regions regions.toml --noise noise.json --flat flat.npz --polarizer"
            " polarizer.json --out stokes --json",
            "compare-panel": "compare runs/panels scene-panels.toml --noise noise.json --scale panel --radiometric"
            " radiometric.json --out compared --json",
            "predict": "predict scene-panels.toml --noise noise.json --radiometric radiometric.json --json",
            "point": 'point runs/panels --focal-px "4217 +- 20" --compass "171 +- 2" --declination "-11.3 +- 0.3"'
            ' --level "-35,0.4 +- 0.3" --json',
        },
    ),
    "roof": Chapter(
        prepare=folders.small_rig,
        commands={
            "plan": "plan rig-roof.toml session-roof.toml --at 2010-05-25T17:07Z --scene scene-roof.toml --json",
            "acquire": f"acquire rig-roof.toml session-roof.toml --out runs/noon {_CLOCK}",
            "status": "status runs/noon --json",
            "log": "status runs/noon --log --json",
            "compare": "compare runs/noon scene-roof.toml --out compared --json",
        },
    ),
    "functions": Chapter(commands={}, values=functions.values, floor=0.0),
}
