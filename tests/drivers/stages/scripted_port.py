"""A port whose far end follows a script, with a clock that only waiting moves on."""


class ScriptedPort:
    """Answers the commands it is told of; each answer is (delay [s], bytes) after the command.

    Parameters
    ----------
    script : list of (bytes, list of (float, bytes))
        What must be written next, and what then comes back.
    """

    name = "scripted port"

    def __init__(self, script: list[tuple[bytes, list[tuple[float, bytes]]]]) -> None:
        self._script = list(script)
        self._coming: list[tuple[float, bytes]] = []
        self._time_s = 0.0

    @property
    def finished(self) -> bool:
        return not self._script

    def now_s(self) -> float:
        return self._time_s

    def sleep(self, duration_s: float) -> None:
        self._time_s += duration_s

    def write(self, data: bytes) -> None:
        expected, answers = self._script.pop(0)
        assert data == expected
        self._coming += [(self._time_s + delay_s, answer) for delay_s, answer in answers]

    def read_some(self, *, timeout_s: float) -> bytes:
        deadline_s = self._time_s + timeout_s
        if self._coming and self._coming[0][0] <= deadline_s:
            due_s, data = self._coming.pop(0)
            self._time_s = max(self._time_s, due_s)
            return data
        self._time_s = deadline_s
        return b""

    def close(self) -> None:
        pass
