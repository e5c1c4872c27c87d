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
        "serve": ("rigctl.verbs.serve:serve", "Operate a rig from a browser, or watch a run while it is taken."),
        "sim": (None, "Serve simulated devices to other programs."),
        "sim stage": ("rigctl.verbs.sim:stage", "Serve a simulated rotation stage on a pseudo-terminal."),
        "sim camera": ("rigctl.verbs.sim:camera", "Serve a simulated camera over GigE Vision."),
        "sim lens": ("rigctl.verbs.sim:lens", "Turn the lens of a simulated camera."),
    },
    "Session": {
        "plan": ("rigctl.verbs.session:plan", "Print the steps of a session, its duration and disk space."),
        "acquire": ("rigctl.verbs.session:acquire", "Take a session: frames at measured polarizer angles."),
        "resume": ("rigctl.verbs.session:resume", "Continue a session that holds or was interrupted."),
        "hold": ("rigctl.verbs.session:hold", "Hold a running session after the current frame."),
        "stop": ("rigctl.verbs.session:stop", "Stop a running session after the current frame."),
    },
    "Run": {
        "status": ("rigctl.verbs.status:status", "Print the progress of a session, the contents of a run, or its log."),
        "note": ("rigctl.verbs.note:note", "Write a note about a run, or exclude frames with a reason."),
        "verify": ("rigctl.verbs.verify:verify", "Check whether a run is complete, unfinished or damaged."),
        "regions": (None, "Draw regions on a picture; find them again by markers."),
        "regions draw": ("rigctl.verbs.regions:draw", "Draw regions on a picture of a run, in a browser."),
        "regions mark": ("rigctl.verbs.regions:mark", "Add the markers in the picture to a regions file."),
        "regions find": ("rigctl.verbs.regions:find", "Find regions again by markers after the camera has moved."),
        "import": ("rigctl.verbs.import_images:import_images", "Make a run from images of other programs."),
        "export": ("rigctl.verbs.export:export", "Write a run as CSV, FITS, TIFF, HDF5 or Zarr."),
        "bundle": ("rigctl.verbs.bundle:bundle", "Pack a run for a bug report, without secrets."),
    },
    "Calibrate": {
        "calibrate": (None, "Calibrate sensor, polarizer, optics or pointing."),
        "calibrate noise": (
            "rigctl.verbs.calibrate:noise",
            "Gain, read noise, dark current, PRNU and DSNU of the sensor.",
        ),
        "calibrate axis": ("rigctl.verbs.axis:axis", "Sense of rotation, axis offset and extinction of the polarizer."),
        "calibrate flat": ("rigctl.verbs.calibrate:flat", "Flat fields for each polarizer angle."),
        "calibrate lens": ("rigctl.verbs.calibrate:lens", "Focal length, principal point and distortion of the lens."),
        "calibrate radiometric": (
            "rigctl.verbs.calibrate:radiometric",
            "Counts per unit of radiance, from a reference panel.",
        ),
        "calibrate registration": (
            "rigctl.verbs.calibrate:registration",
            "Shift of the picture at each polarizer angle.",
        ),
        "calibrate doubling": ("rigctl.verbs.calibrate:doubling", "Temperature rise that doubles the dark current."),
        "calibrate stage": (
            "rigctl.verbs.calibrate_stage:stage",
            "Readback error, backlash and settling time of the stage.",
        ),
        "calibrate pointing": ("rigctl.verbs.pointing:pointing", "Direction of the camera and tilt of panels."),
        "calibrate list": ("rigctl.verbs.store:list_store", "List the stored calibrations, and which are picked."),
        "calibrate history": ("rigctl.verbs.store:history", "Changes of calibrated numbers over time."),
    },
    "Measure": {
        "look": ("rigctl.verbs.look:look", "Show S0, DoLP and AoLP maps of a few images, uncalibrated."),
        "stokes": ("rigctl.verbs.stokes:stokes", "Measure Stokes parameters, DoLP and AoLP of a run and its regions."),
        "detect": ("rigctl.verbs.detect:detect", "Detect a target by its polarization: RX map and ROC of a run."),
        "compare": ("rigctl.verbs.compare:compare", "Compare a run with the model, and give a verdict."),
        "infer": (
            "rigctl.verbs.infer:infer",
            "Infer uncertain numbers of a scene from runs.",
        ),
    },
    "Model": {
        "predict": ("rigctl.verbs.predict:predict", "Predict counts, Stokes parameters and DoLP of a scene."),
        "sweep": ("rigctl.verbs.predict:sweep", "Predict a scene over ranges of its numbers."),
        "effects": ("rigctl.verbs.effects:effects", "List the effects that matter in a scene, and why."),
        "tradeoff": ("rigctl.verbs.tradeoff:tradeoff", "Show the cost of accuracy in computing or session time."),
        "sky": ("rigctl.verbs.sky:sky", "Compute the polarized sky of a scene."),
        "surface": ("rigctl.verbs.surface:surface", "Print DoLP and reflectance of a material against angle."),
        "paper": ("rigctl.verbs.paper:paper", "Reproduce figures and statements of the paper, with verdicts."),
    },
    "Many runs": {
        "archive": (None, "Index an archive of runs, find runs in it, and process all of them."),
        "archive index": ("rigctl.verbs.archive:index", "Make or update the index of an archive."),
        "archive find": ("rigctl.verbs.archive:find", "Print the runs and regions that fulfil a condition."),
        "archive health": ("rigctl.verbs.archive:health", "Print how the rig changed from run to run."),
        "archive compare": ("rigctl.verbs.archive:compare", "Compare every run with the model."),
        "archive stokes": ("rigctl.verbs.archive:stokes", "Measure every run."),
        "archive verify": ("rigctl.verbs.archive:verify", "Check every checksum of every run."),
        "archive recalibrate": ("rigctl.verbs.archive:recalibrate", "Measure every run again with other calibrations."),
        "study": ("rigctl.verbs.study:study", "Predict thousands of cases: grids, random draws, sensitivity."),
    },
}

VERBS = tuple(verb for verbs in HEADINGS.values() for verb in verbs)
