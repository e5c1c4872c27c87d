"""The chapters: which commands are run, in which folder.

A renamed verb or option is one edit here. Names of chapters and commands stay: what is stored stands under them.
"""

from tests.golden import folders, functions
from tests.golden.harness import Chapter

_CLOCK = "--clock 2010-05-25T17:07Z"
_FAST_SCENES = {
    "airborne": "scene-airborne.toml",
    "panels": "scene-panels.toml",
    "roof": "scene-roof.toml",
    "rooftop-noon-by-time": "scene-rooftop-noon-by-time.toml",
    "paper-rough": "paper/rough.toml",
    "effects-lamp": "effects/lamp.toml",
    "effects-twilight": "effects/twilight.toml",
}
_SCENES = _FAST_SCENES | {
    "panels-uncertain": "scene-panels-uncertain.toml",
    "rooftop-morning": "scene-rooftop-morning.toml",
    "rooftop-morning-by-time": "scene-rooftop-morning-by-time.toml",
    "rooftop-noon": "scene-rooftop-noon.toml",
    "rooftop-own-aerosol": "scene-rooftop-own-aerosol.toml",
    "paper-library": "paper/library.toml",
    "effects-airborne": "effects/airborne.toml",
    "effects-bench": "effects/bench.toml",
    "effects-roof-3m": "effects/roof-3m.toml",
}
_COMPARE = "compare runs/{run} scene-panels.toml --out compared-{name} --json"

_ERRORS = {
    "verb": "comapre",
    "verb-json": "comapre --json",
    "inner-verb": "calibrate nois --json",
    "option": "predict scene-panels.toml --noize x --json",
    "option-of-no-verb": "predict scene-panels.toml --seed 1 --json",
    "no-argument": "predict --json",
    "number": "predict scene-panels.toml --tolerance abc --json",
    "range": "effects scene-panels.toml --tolerance 0 --json",
    "choice": "compare x scene-panels.toml --scale panle --out o --json",
    "alpha": "compare x scene-panels.toml --alpha 1.5 --out o --json",
    "export-choice": "export x --to tif --out o",
    "key": "predict scene-panels.toml --set sensor.f_numbr=2 --json",
    "key-value": "predict scene-panels.toml --set sensor.f_number=two --json",
    "sweep": "sweep scene-panels.toml sun.zenith_deg=10:80:8 --json",
    "effect": "predict scene-panels.toml --without textur --json",
    "material": "surface black-pant --json",
    "perturb": "demo --perturb nothing --out demo --json",
    "rig-as-scene": "predict rig-sim.toml --json",
    "scene-as-session": "plan rig-sim.toml scene-panels.toml --json",
    "rig-as-noise": "predict scene-panels.toml --noise rig-sim.toml --json",
    "no-file": "predict nothere.toml --json",
    "file-as-run": "verify scene-panels.toml --json",
    "no-run": "status nowhere --json",
    "folder-as-run": "status . --contents --json",
    "log-of-nothing": "status nowhere --log --json",
    "new-in-full-folder": "new . --simulated --json",
    "scene-key": "predict wrong-key.toml --json",
    "scene-text": "predict wrong-text.toml --json",
    "scene-number": "predict wrong-number.toml --json",
    "scene-toml": "predict wrong-toml.toml --json",
    "scene-missing": "predict wrong-missing.toml --json",
    "scene-stokes": "predict wrong-stokes.toml --json",
    "rig-driver": "acquire wrong-driver.toml session.toml --out run --dry-run",
    "rig-sense": "acquire wrong-sense.toml session.toml --out run --dry-run",
    "session-needs-site": "acquire rig-sim.toml session-rooftop.toml --out run --dry-run",
    "zone": "acquire rig-sim.toml session.toml --out run --dry-run --at 2026-05-04T12:00",
    "twice": "predict scene-panels.toml --tolerance 0.1 --tolerance 0.1 --json",
    "noise-of-nothing": "calibrate noise --out noise.json --json",
    "registration-of-nothing": "calibrate registration nowhere --json",
}

CHAPTERS = {
    "predictions": Chapter(
        prepare=folders.examples,
        commands={name: f"predict {scene} --json" for name, scene in _FAST_SCENES.items()}
        | {
            "uncertainty": "predict scene-panels-uncertain.toml --uncertainty --json",
            "set": "predict scene-panels.toml --set sensor.f_number=4 --set acquisition.exposure_ms=0.1 --json",
            "roc": "predict scene-panels.toml --roc black_panel,asphalt --snr both --out roc"
            " --write-truth truth.toml --json",
            "light": "predict scene-airborne.toml --light reflected_sun --json",
            "sweep": "sweep scene-panels.toml sensor.f_number=2:8:4 --out sweep --json",
            "grid": "sweep scene-panels.toml sensor.f_number=2:8:3 acquisition.exposure_ms=0.01:0.03:3 --json",
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
            "dolp-estimators": "paper --estimators --json",
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
            "turned": f"acquire rig-turned.toml session.toml --out runs/turned {_CLOCK}",
            "compare-turned": _COMPARE.format(run="turned", name="turned"),
            "mosaic": f"acquire rig-mosaic.toml session.toml --out runs/mosaic {_CLOCK}",
            "stokes-mosaic": "stokes runs/mosaic --regions regions.toml --out stokes-mosaic --json",
        },
    ),
    "stopped": Chapter(
        prepare=folders.small_rig,
        commands={
            "dry-run": "acquire rig-sim.toml session.toml --out runs/dry --dry-run",
            "until": f"acquire rig-sim.toml session.toml --out runs/short {_CLOCK} --until 2010-05-25T17:07:04Z",
            "status": "status runs/short --json",
            "verify": "verify runs/short --json",
            "stokes": "stokes runs/short --out stokes --json",
            "resume": "resume runs/short",
            "status-after": "status runs/short --json",
            "log-after": "status runs/short --log --only finished --json",
            "no-run": "status runs/none --contents --json",
            "new": "new rig --simulated --no-input --json",
            "new-real": "new real-rig --stage /dev/ttyUSB0 --camera gige:192.168.0.5 --latitude-deg 43.1"
            " --longitude-deg -77.7 --no-input --json",
            "new-again": "new rig --simulated --no-input --json",
        },
    ),
    "archive": Chapter(
        prepare=folders.rig_with_store,
        commands={
            "one": f"acquire rig-sim.toml session.toml --out runs/one {_CLOCK}",
            "two": "acquire rig-sim.toml session-many.toml --out runs/june/two --clock 2010-06-25T17:07Z",
            "index": "archive index runs --json",
            "find": 'archive find runs "frames > 15" --json',
            "find-csv": 'archive find runs "frames > 1" --csv',
            "find-wrong": 'archive find runs "nothing > 1" --json',
            "health": "archive health runs --json",
            "noise-run": f"acquire rig-sim.toml session-noise.toml --out runs/noise {_CLOCK}",
            "noise": "calibrate noise --run runs/noise --out calibrations/noise.json --json",
            "calibrations": "calibrate list calibrations --at 2010-05-26T00:00Z --json",
            "calibrations-for": "calibrate list calibrations --for runs/one --at 2010-05-26T00:00Z --json",
            "stokes": "stokes runs/one --calibrations calibrations --out stokes --json",
            "history": "calibrate history calibrations --out history.png --json",
        },
    ),
    "errors": Chapter(prepare=folders.wrong_files, commands=_ERRORS),
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
            "point": 'calibrate pointing runs/panels --focal-px "4217 +- 20" --compass "171 +- 2"'
            ' --declination "-11.3 +- 0.3" --level "-35,0.4 +- 0.3" --json',
        },
    ),
    "roof": Chapter(
        prepare=folders.small_rig,
        commands={
            "plan": "plan rig-roof.toml session-roof.toml --at 2010-05-25T17:07Z --scene scene-roof.toml --json",
            "acquire": f"acquire rig-roof.toml session-roof.toml --out runs/noon {_CLOCK}",
            "status": "status runs/noon --json",
            "log": "status runs/noon --log --json",
        },
    ),
    "functions": Chapter(commands={}, values=functions.values, floor=0.0),
    # Chapters that take minutes.
    "demo": Chapter(
        is_long=True,
        ignored="/drift/|share_of_standard_error|p_value",  # the clock is not simulated
        commands={
            "sound": "demo --out sound --json",
            "angle-offset": "demo --out angle-offset --perturb angle-offset --json",
            "gain": "demo --out gain --perturb gain --seed 3 --json",
        },
    ),
    "comparisons": Chapter(
        is_long=True,
        prepare=folders.perturbed_rig,
        commands={
            "panels": f"acquire rig-sim.toml session.toml --out runs/panels {_CLOCK}",
            "compare-free": _COMPARE.format(run="panels", name="free") + " --scale free",
            "compare-uncertain": "compare runs/panels scene-panels-uncertain.toml --out compared-uncertain --json",
            "many": f"acquire rig-sim.toml session-many.toml --out runs/many {_CLOCK}",
            "compare-many": _COMPARE.format(run="many", name="many"),
            "weak": f"acquire rig-weak.toml session.toml --out runs/weak {_CLOCK}",
            "compare-weak": _COMPARE.format(run="weak", name="weak"),
            "compare-weak-free": _COMPARE.format(run="weak", name="weak-free") + " --scale free",
            "compare-two": "compare runs/panels runs/weak --scene scene-panels.toml --out compared-two --json",
            "mosaic": f"acquire rig-mosaic.toml session.toml --out runs/mosaic {_CLOCK}",
            "compare-mosaic": _COMPARE.format(run="mosaic", name="mosaic"),
            "exclude": 'note runs/panels "a bird" --exclude 5,7-8 --by ann --json',
            "compare-excluded": _COMPARE.format(run="panels", name="excluded"),
            "noon": f"acquire rig-roof.toml session-roof.toml --out runs/noon {_CLOCK}",
            "compare-noon": "compare runs/noon scene-roof.toml --out compared-noon --json",
            "aerosol": f"acquire rig-roof.toml session-roof.toml --out runs/aerosol --perturb aerosol {_CLOCK}",
            "compare-aerosol": "compare runs/aerosol scene-roof.toml --out compared-aerosol --json",
        },
    ),
    "tolerances": Chapter(
        is_long=True,
        ignored="on_front|reference_s",  # depend on measured times
        prepare=folders.examples,
        commands={
            f"{name}-{tolerance}": f"predict {scene} --tolerance {tolerance} --json"
            for name, scene in _SCENES.items()
            for tolerance in ("0.1", "0.01", "0.003")
        }
        | {
            f"effects-{name}-{tolerance}": f"effects {scene} --tolerance {tolerance} --json"
            for name, scene in _SCENES.items()
            for tolerance in ("0.1", "0.01", "0.001")
        }
        | {name: f"predict {scene} --json" for name, scene in _SCENES.items() if name not in _FAST_SCENES}
        | {
            "sky-sweep": "sweep scene-airborne.toml sun.zenith_deg=20:60:3 --json",
            "sweep-0.01": "sweep scene-airborne.toml sun.zenith_deg=20:60:9 --tolerance 0.01 --json",
            "all-effects": "predict scene-airborne.toml --tolerance 0.01 --effects all --json",
            "aerosols": "sky scene-airborne.toml --compare-aerosols --out sky --json",
            "uncertain-roof": "predict scene-roof.toml --uncertainty --json",
            "fig5": "paper --figure 5 --out fig5 --json",
            "verify": "effects scene-panels.toml --tolerance 0.02 --verify --json",
            "tradeoff": "tradeoff scene-airborne.toml --tolerances 0.1,0.03,0.01 --out tradeoff --json",
            "tradeoff-acquisition": "tradeoff scene-airborne.toml --acquisition --target-dolp-sigma 0.002 --json",
        },
    ),
    "paper": Chapter(is_long=True, commands={"paper": "paper --as-paper --out paper --json"}),
    "noise-sets": Chapter(is_long=True, commands={}, values=functions.noise_sets, floor=0.0, by_error=True),
    "cluster": Chapter(
        is_long=True,
        needs=("distributed", "pyarrow", "xarray", "zarr"),
        prepare=folders.small_rig,
        commands={
            "study": "study study-panels.toml --out study --workers 2 --json",
            "one": f"acquire rig-sim.toml session.toml --out runs/one {_CLOCK}",
            "two": "acquire rig-sim.toml session-many.toml --out runs/june/two --clock 2010-06-25T17:07Z",
            "stokes": "archive stokes runs --regions regions.toml --out measured --workers 2 --json",
            "compare": "archive compare runs --scene scene-panels.toml --out compared --workers 2 --json",
            "verify": "archive verify runs --out verified --workers 2 --json",
            "export-zarr": "export runs/one --to zarr --out one.zarr",
        },
    ),
    "real": Chapter(
        is_long=True,
        is_real=True,
        prepare=folders.real_regions,
        commands={
            "ccd12": "calibrate noise --emva $RIGCTL_REAL_DATA/emva_ccd12/EMVA1288_Data.txt --out ccd12.json --json",
            "cmos8": "calibrate noise --emva $RIGCTL_REAL_DATA/emva_cmos8/EMVA1288_Data.txt --out cmos8.json --json",
            "lasco": "import lasco $RIGCTL_REAL_DATA/lasco_c2_triplet/lasco_0.fts"
            " $RIGCTL_REAL_DATA/lasco_c2_triplet/lasco_+60.fts $RIGCTL_REAL_DATA/lasco_c2_triplet/lasco_-60.fts"
            " --angles 0,60,-60 --exposure-key EXPTIME --black-level-key OFFSET --bit-depth 16",
            "lasco-stokes": "stokes lasco --out lasco-stokes --json",
            "lasco-compare": "compare lasco --regions regions.toml --out lasco-compared --json",
        }
        | {
            f"{name}{verb}": line.format(name=name)
            for name in ("fruits", "carps", "polarizer")
            for verb, line in {
                "": "import {name} $RIGCTL_REAL_DATA/imx250_{name}/{name}_IMX250MZR.png --mosaic 90,45,135,0"
                " --black-level-dn 0 --same-exposure",
                "-stokes": "stokes {name} --out {name}-stokes --json",
                "-compare": "compare {name} --regions regions.toml --out {name}-compared --json",
            }.items()
        }
        | {
            name: f"import {name} "
            + " ".join(f"$RIGCTL_REAL_DATA/mueller_psa/{state}/p{angle:03d}.png" for angle in range(0, 360, 45))
            + f" --angles {','.join(map(str, range(0, 360, 45)))} --black-level-dn 0 --same-exposure"
            for name, state in (("psa", "460nm_g0/a0"),)
        }
        | {"psa-compare": "compare psa --regions regions.toml --out psa-compared --json"},
    ),
}
