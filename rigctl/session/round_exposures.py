"""The exposure of each step: as planned, or metered when its round begins."""

from collections.abc import Mapping, Sequence

from rigctl.files.session_file import MeteringSection
from rigctl.runs.run_writer import RunWriter
from rigctl.session.metering import bright_share, meter
from rigctl.session.planning.session_steps import Step
from rigctl.session.rig_work import RigWork


class RoundExposures:
    """Meters each round once.

    Parameters
    ----------
    steps : sequence of Step
        Of the session.
    work : RigWork
        Takes the pictures by which it is metered.
    writer : RunWriter
        Where the result is noted, for a resume.
    metering : MeteringSection
        What is wanted.
    metered_s : mapping
        What was metered before, by round [s].
    """

    def __init__(
        self,
        steps: Sequence[Step],
        work: RigWork,
        writer: RunWriter,
        *,
        metering: MeteringSection,
        metered_s: Mapping[int, float],
    ) -> None:
        self._steps, self._work, self._writer = steps, work, writer
        self._metering = metering
        self._metered_s = dict(metered_s)

    def of(self, step: Step) -> float:
        """Return the exposure of a step [s].

        Raises
        ------
        DeviceError
            It has to be metered, and a device fails.
        """
        if step.exposure_s is not None:
            return step.exposure_s
        if step.round not in self._metered_s:
            self._metered_s[step.round] = self._metered(step.round)
        return self._metered_s[step.round] * step.exposure_factor

    def _metered(self, number: int) -> float:
        angles = {s.polarizer_angle_deg for s in self._steps if s.round == number and s.kind == "scene"}
        ordered = sorted(angles, key=lambda angle: angle or 0.0)
        self._work.present("scene")
        found = meter(
            lambda exposure_s: {angle: self._bright_share(exposure_s, angle) for angle in ordered}, self._metering
        )
        self._writer.event(
            "metered",
            round=number,
            exposure_s=found.exposure_s,
            shares={str(angle): share for angle, share in found.shares.items()},
            remark=found.remark,
            next_camera_frame=self._work.next_number,
        )
        return found.exposure_s

    def _bright_share(self, exposure_s: float, angle_deg: float | None) -> float:
        frame = self._work.shoot(exposure_s=exposure_s, polarizer_angle_deg=angle_deg).frame
        full_dn = float(2**frame.settings.bit_depth - 1)
        return bright_share(frame.counts, quantile=self._metering.quantile, full_dn=full_dn)
