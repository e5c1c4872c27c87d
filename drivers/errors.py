"""Failures of devices.

Every message names the device, what was sent, what came back and what to try.
"""


class DeviceError(Exception):
    """A device did not do what it was asked. The root of every error that a driver raises."""


class NotConnectedError(DeviceError):
    """There is no such device, it is in use by another program, or it has gone away."""


class DeviceTimeoutError(DeviceError):
    """The device did not answer, or did not finish, within its deadline."""


class ProtocolError(DeviceError):
    """The device sent something that its protocol does not allow."""


class DeviceFaultError(DeviceError):
    """The device reports a fault of its own.

    Attributes
    ----------
    code : int or str
        The device's own number or letters for the fault.
    meaning : str
        What the device's manual says that the code means.
    """

    def __init__(self, message: str, *, code: int | str, meaning: str) -> None:
        super().__init__(message)
        self.code = code
        self.meaning = meaning


class LimitError(DeviceError):
    """A request is outside of what the device can do, or a result outside of what was asked for."""


class AddressError(LimitError):
    """An address or an option is wrong before any device is asked: whoever wrote it has to mend it."""
