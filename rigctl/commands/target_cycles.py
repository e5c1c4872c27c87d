"""``rigctl acquire --scene S --target-dolp-sigma T``: as many cycles as bring the error of DoLP to a target."""

from pathlib import Path

from rigctl.calibrations.noise.noise_file import NoiseParameters
from rigctl.errors import ConfigError
from rigctl.files.session_file import SessionFile
from rigctl.terminal import progress


def with_target(
    session: SessionFile, noise: NoiseParameters | None, *, scene: Path | None, target_dolp_sigma: float | None
) -> SessionFile:
    """Return a session with the cycles that a target asks for; the session itself where there is no target.

    Raises
    ------
    ConfigError
        One of the two options without the other, or no number of cycles reaches the target.
    """
    if (scene is None) != (target_dolp_sigma is None):
        raise ConfigError("--scene and --target-dolp-sigma: give both, or neither")
    if scene is None or target_dolp_sigma is None:
        return session
    # The model of the scene is imported where it is asked for: a session without a target starts at once.
    from rigctl.files.scene_file import load_scene
    from rigctl.jobs.target_cycles import with_cycles_for

    chosen, lines = with_cycles_for(session, load_scene(scene), noise, target_dolp_sigma=target_dolp_sigma)
    for line in lines:
        progress().print(f"--target-dolp-sigma: {line}", markup=False)
    return chosen
