"""The verbs: one function each, under the headings that `rigctl --help` shows, in the order of use."""

# Heading -> {verb: (function, one line of help)}; None is a group of verbs. The module of a function is imported when
# its verb is called.
HEADINGS: dict[str, dict[str, tuple[str | None, str]]] = {
    "Start": {
        "demo": ("rigctl.verbs.demo:demo", "Run the whole job on a simulated rig: session, calibration, report."),
        "new": ("rigctl.verbs.new:new", "Write the files of a new rig into a folder, ready to run."),
        "doctor": ("rigctl.verbs.doctor:doctor", "Check network, disk, clock and devices, and say what to change."),
    },
    "Rig": {
        "devices": ("rigctl.verbs.devices:devices", "List ports, stages and cameras, with lines for the rig file."),
        "preview": ("rigctl.verbs.preview:preview", "Show what a camera sees, and how sharp it is, for focusing."),
        "serve": ("rigctl.verbs.serve:serve", "Work a rig from a browser, or watch a run as it grows."),
        "sim": (None, "Serve simulated devices to other programs."),
        "sim stage": ("rigctl.verbs.sim:stage", "Serve a simulated rotation stage on a pseudo-terminal."),
        "sim camera": ("rigctl.verbs.sim:camera", "Serve a simulated camera over GigE Vision."),
        "sim lens": ("rigctl.verbs.sim:lens", "Turn the lens of a simulated camera."),
    },
    "Session": {
        "plan": ("rigctl.verbs.session:plan", "Print the steps of a session, and what it can give."),
        "acquire": ("rigctl.verbs.session:acquire", "Take a session: durable frames at measured polarizer angles."),
        "resume": ("rigctl.verbs.session:resume", "Go on with a session that holds or was interrupted."),
        "hold": ("rigctl.verbs.session:hold", "Ask a running session to hold after this frame."),
        "stop": ("rigctl.verbs.session:stop", "Ask a running session to stop after this frame."),
    },
    "Run": {
        "status": ("rigctl.verbs.status:status", "Print where a session stands, what its run holds, and its log."),
        "note": ("rigctl.verbs.note:note", "Write a note about a run, or exclude frames with a reason."),
        "verify": ("rigctl.verbs.verify:verify", "Check a run: whole, unfinished or damaged."),
        "regions": (None, "Draw regions on a picture; find them again by markers."),
        "regions draw": ("rigctl.verbs.regions:draw", "Draw regions on a picture of a run, in a browser."),
        "regions mark": ("rigctl.verbs.regions:mark", "Write down where the markers of the picture are."),
        "regions find": ("rigctl.verbs.regions:find", "Find regions again by their markers."),
        "import": ("rigctl.verbs.import_images:import_images", "Make a run out of images that exist."),
        "export": ("rigctl.verbs.export:export", "Write a run as CSV, FITS, TIFF, HDF5 or Zarr."),
        "bundle": ("rigctl.verbs.bundle:bundle", "Pack a run for a report of a fault, without secrets."),
    },
    "Calibrate": {
        "calibrate": (None, "Calibrate sensor, polarizer, optics and pointing, each number with its error."),
        "calibrate noise": ("rigctl.verbs.calibrate:noise", "Gain, read noise, dark current, PRNU, DSNU of a sensor."),
        "calibrate axis": ("rigctl.verbs.axis:axis", "Sense, axis offset and extinction of the polarizer."),
        "calibrate flat": ("rigctl.verbs.calibrate:flat", "Flat fields behind each angle of the polarizer."),
        "calibrate lens": ("rigctl.verbs.calibrate:lens", "Focal length, principal point, distortion of a lens."),
        "calibrate radiometric": ("rigctl.verbs.calibrate:radiometric", "Counts per unit of radiance, by a panel."),
        "calibrate registration": ("rigctl.verbs.calibrate:registration", "Shift of the picture at each angle."),
        "calibrate doubling": ("rigctl.verbs.calibrate:doubling", "Rise of temperature that doubles the dark current."),
        "calibrate stage": (
            "rigctl.verbs.calibrate_stage:stage",
            "Measure a rotation stage: readback error, backlash, settling.",
        ),
        "calibrate pointing": ("rigctl.verbs.pointing:pointing", "Where camera and panels point."),
        "calibrate list": ("rigctl.verbs.store:list_store", "List the store of calibrations, and which are picked."),
        "calibrate history": ("rigctl.verbs.store:history", "How the numbers of calibrations have moved."),
    },
    "Measure": {
        "look": ("rigctl.verbs.look:look", "Show S0, DoLP and AoLP maps of a few images, uncalibrated."),
        "stokes": ("rigctl.verbs.stokes:stokes", "Measure Stokes parameters, DoLP and AoLP of a run and its regions."),
        "detect": ("rigctl.verbs.detect:detect", "Detect a target by its polarization: RX map and ROC of a run."),
        "compare": ("rigctl.verbs.compare:compare", "Compare a run with the model, with a verdict."),
        "infer": (
            "rigctl.verbs.infer:infer",
            "Infer uncertain numbers of a scene from runs: material, aerosol, scale.",
        ),
    },
    "Model": {
        "predict": ("rigctl.verbs.predict:predict", "Predict counts, Stokes parameters and DoLP of a scene."),
        "sweep": ("rigctl.verbs.predict:sweep", "Predict a scene over ranges of its numbers."),
        "effects": ("rigctl.verbs.effects:effects", "Which effects a scene calls for, and why."),
        "tradeoff": ("rigctl.verbs.tradeoff:tradeoff", "What accuracy costs in time, computed or on the roof."),
        "sky": ("rigctl.verbs.sky:sky", "The polarized sky of a scene: S0, S1, S2, DoLP, with the sun marked."),
        "surface": ("rigctl.verbs.surface:surface", "DoLP and reflectance of a material against angle, with sources."),
        "paper": ("rigctl.verbs.paper:paper", "Figures and statements of the paper, with verdicts."),
    },
    "Many runs": {
        "archive": (None, "Index an archive of runs, find runs in it, and do a verb over all of them."),
        "archive index": ("rigctl.verbs.archive:index", "Make or update the index of an archive."),
        "archive find": ("rigctl.verbs.archive:find", "Print the runs and regions of which an expression holds."),
        "archive health": ("rigctl.verbs.archive:health", "Print how the rig fared from run to run."),
        "archive compare": ("rigctl.verbs.archive:compare", "Compare every run with the model."),
        "archive stokes": ("rigctl.verbs.archive:stokes", "Measure every run."),
        "archive verify": ("rigctl.verbs.archive:verify", "Check every checksum of every run."),
        "archive recalibrate": ("rigctl.verbs.archive:recalibrate", "Measure every run anew with other calibrations."),
        "study": ("rigctl.verbs.study:study", "Predict thousands of cases on dask: grids, draws, which input matters."),
    },
}

VERBS = tuple(verb for verbs in HEADINGS.values() for verb in verbs)
