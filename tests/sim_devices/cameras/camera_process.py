"""A simulated GigE camera in a process of its own, which can be killed, stopped and started again."""

import signal
import subprocess
import sys
from contextlib import contextmanager

from sim_devices.cameras.gige_server import serve_gige_camera
from tests.sim_devices.cameras.gige_port import ADDRESS
from tests.sim_devices.cameras.known_pictures import KnownPictures

WIDTH, HEIGHT = 64, 48


class CameraProcess:
    """The process; `start` it."""

    def __init__(self):
        self._process = None

    def start(self):
        self._process = subprocess.Popen([sys.executable, "-m", __name__], stdout=subprocess.PIPE, text=True)
        assert self._process.stdout.readline() == "ready\n"

    def kill(self):
        self._process.kill()
        self._process.wait()
        self._process.stdout.close()

    def hang(self):
        self._process.send_signal(signal.SIGSTOP)

    def go_on(self):
        self._process.send_signal(signal.SIGCONT)


@contextmanager
def camera_process():
    """Give a camera that serves, and end it however the test left it."""
    process = CameraProcess()
    process.start()
    try:
        yield process
    finally:
        process.kill()


def main():
    with serve_gige_camera(KnownPictures(width=WIDTH, height=HEIGHT), address=ADDRESS):
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        signal.pause()


if __name__ == "__main__":
    main()
