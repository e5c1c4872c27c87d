"""The controls of a video device: everything automatic off, exposure and gain set and read back."""

from drivers.cameras import v4l2_structs as v4l2
from drivers.cameras.v4l2_node import VideoNode, told
from drivers.cameras.v4l2_options import V4l2Options
from drivers.errors import LimitError

_EXPOSURE_STEP_S = 100e-6


class V4l2Controls:
    """The controls of one device.

    Attributes
    ----------
    used : dict
        Name and value of every control that was set.
    """

    def __init__(self, node: VideoNode, options: V4l2Options) -> None:
        self._node, self._options = node, options
        self.used: dict[str, str] = {}
        for control, off in v4l2.AUTOMATIC.items():
            if self._described(control) is not None:
                self._set(control, off)
        self._exposure_s = 0.0
        if options.exposure_control == "device" and self._described(v4l2.EXPOSURE_ABSOLUTE) is None:
            raise LimitError(
                f"video device {node.path}: it has no exposure in units of 100 us; where it is set by other means, say "
                "exposure_control=none in its address"
            )

    def set(self, *, exposure_s: float, gain_db: float) -> None:
        """Set exposure and gain; a refusal changes nothing.

        Raises
        ------
        LimitError
            A value is outside of what the device allows, or not a step of it.
        """
        steps = self._exposure_steps(exposure_s)
        gain = self._gain(gain_db)
        if steps is not None:
            self._set(v4l2.EXPOSURE_ABSOLUTE, steps)
        if gain is not None:
            self._set(v4l2.GAIN, gain)
        self._exposure_s = exposure_s

    def exposure_s(self) -> float:
        """Read the exposure; return what was said last where the device has none."""
        if self._options.exposure_control == "none":
            return self._exposure_s
        return self._get(v4l2.EXPOSURE_ABSOLUTE) * _EXPOSURE_STEP_S

    def gain_db(self) -> float:
        """Read the gain."""
        limits = self._described(v4l2.GAIN)
        if limits is None:
            return 0.0
        return (self._get(v4l2.GAIN) - int(limits.minimum)) * (self._options.gain_step_db or 0.0)

    def found(self) -> dict[str, str]:
        """Return name and value of the controls that bend or shift counts, which are left as they were found."""
        there = ((control, self._described(control)) for control in v4l2.PROCESSING)
        return {
            described.name.decode(): f"{self._get(control)} (as found)"
            for control, described in there
            if described is not None
        }

    def require_manual(self) -> None:
        """Refuse a device on which something automatic is on again."""
        for control, off in v4l2.AUTOMATIC.items():
            described = self._described(control)
            if described is not None and (found := self._get(control)) != off:
                raise LimitError(
                    f"video device {self._node.path}: {described.name.decode()} is {found} again instead of {off}: "
                    "another program has switched it on"
                )

    def _exposure_steps(self, exposure_s: float) -> int | None:
        if not 0.0 < exposure_s < float("inf"):
            raise LimitError(f"video device {self._node.path}: exposure_s is {exposure_s} s; it has to be above 0")
        limits = self._described(v4l2.EXPOSURE_ABSOLUTE)
        if self._options.exposure_control == "none" or limits is None:
            return None
        steps = round(exposure_s / _EXPOSURE_STEP_S)
        if not limits.minimum <= steps <= limits.maximum:
            raise LimitError(
                f"video device {self._node.path}: exposure_s is {exposure_s} s; it takes "
                f"{limits.minimum * _EXPOSURE_STEP_S:g} to {limits.maximum * _EXPOSURE_STEP_S:g} s"
            )
        return steps

    def _gain(self, gain_db: float) -> int | None:
        limits = self._described(v4l2.GAIN)
        step_db = self._options.gain_step_db
        if limits is None or step_db is None:
            if gain_db != 0.0:
                raise LimitError(
                    f"video device {self._node.path}: gain_db is {gain_db} dB; a step of its gain is not known in dB: "
                    "state gain_step_db=X in its address, or ask for 0"
                )
            return None if limits is None else int(limits.minimum)
        steps = gain_db / step_db
        if not 0 <= steps <= limits.maximum - limits.minimum or steps != round(steps):
            raise LimitError(
                f"video device {self._node.path}: gain_db is {gain_db} dB; it takes 0 to "
                f"{(limits.maximum - limits.minimum) * step_db:g} dB in steps of {step_db:g} dB"
            )
        return int(limits.minimum) + round(steps)

    def _described(self, control: int) -> v4l2.QueryControl | None:
        described = v4l2.QueryControl(id=control)
        try:
            self._node.request(v4l2.QUERYCTRL, described)
        except OSError:
            return None  # the device has no such control: this request has no other way to say so
        return None if described.flags & v4l2.DISABLED_CONTROL else described

    def _get(self, control: int) -> int:
        content = v4l2.Control(id=control)
        try:
            self._node.request(v4l2.G_CTRL, content)
        except OSError as error:
            raise told(error, path=self._node.path, what=f"control {control:#x}") from error
        return int(content.value)

    def _set(self, control: int, value: int) -> None:
        try:
            self._node.request(v4l2.S_CTRL, v4l2.Control(id=control, value=value))
        except OSError as error:
            raise told(error, path=self._node.path, what=f"control {control:#x} = {value}") from error
        described = self._described(control)
        name = described.name.decode() if described is not None else f"{control:#x}"
        if (found := self._get(control)) != value:
            raise LimitError(f"video device {self._node.path}: {name} was set to {value}, and is {found}")
        self.used[name] = str(value)
