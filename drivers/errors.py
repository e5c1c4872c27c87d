"""Failures of devices.

Every message states the device, the request, the answer and what to try.
"""


class DeviceError(Exception):
    """A device did not do as requested. Base class of all errors of drivers."""


class NotConnectedError(DeviceError):
    """The device does not exist, is used by another program, or was disconnected."""


class DeviceTimeoutError(DeviceError):
    """The device did not answer, or did not finish, within its deadline."""


class ProtocolError(DeviceError):
    """The device violated its protocol."""


class DeviceFaultError(DeviceError):
    """The device reports a fault of its own.

    Attributes
    ----------
    code : int or str
        The device's own number or letters for the fault.
    meaning : str
        Meaning of the code in the device's manual.
    """

    def __init__(self, message: str, *, code: int | str, meaning: str) -> None:
        super().__init__(message)
        self.code = code
        self.meaning = meaning


class LimitError(DeviceError):
    """A request is beyond the device's limits, or a result beyond the requested tolerance."""


class AddressError(LimitError):
    """An address or option is wrong, as found before any device is asked."""
