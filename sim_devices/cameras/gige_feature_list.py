"""Features of the simulated GigE camera: the library's own list, and more in the same memory."""

import re

from sim_devices.cameras.sample_bytes import FORMATS

# Registers of the library's device.
SENSOR_HEIGHT, SENSOR_WIDTH, WIDTH, HEIGHT = 0x118, 0x11C, 0x100, 0x104
OFFSET_X, OFFSET_Y = 0x130, 0x134
EXPOSURE_US = 0x120
GAIN_AUTO = 0x114
# Memory that it does not use.
EXPOSURE_AUTO, REVERSE_X, TEMPERATURE_TENTHS_C, GAMMA = 0x400, 0x404, 0x408, 0x40C
EXPOSURE_AUTO_OFF, EXPOSURE_AUTO_CONTINUOUS = 0, 2
GAIN_AUTO_OFF, GAIN_AUTO_CONTINUOUS = 1, 2

_REGISTER = """
<IntReg Name="{name}Register" NameSpace="Custom"><Address>{address:#x}</Address><Length>4</Length>
<AccessMode>{access}</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>
"""
_EXPOSURE_AUTO = """
<Enumeration Name="ExposureAuto" NameSpace="Standard">
<EnumEntry Name="Off" NameSpace="Standard"><Value>0</Value></EnumEntry>
<EnumEntry Name="Once" NameSpace="Standard"><Value>1</Value></EnumEntry>
<EnumEntry Name="Continuous" NameSpace="Standard"><Value>2</Value></EnumEntry>
<pValue>ExposureAutoRegister</pValue></Enumeration>
"""
_SWITCH = """
<Boolean Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>
<OnValue>1</OnValue><OffValue>0</OffValue></Boolean>
"""
_TEMPERATURE = """
<Float Name="DeviceTemperature"><pValue>DeviceTemperatureConverter</pValue></Float>
<Converter Name="DeviceTemperatureConverter"><FormulaTo>(FROM * 10)</FormulaTo><FormulaFrom>(TO / 10.0)</FormulaFrom>
<pValue>DeviceTemperatureInteger</pValue></Converter>
<Integer Name="DeviceTemperatureInteger" NameSpace="Custom"><pValue>DeviceTemperatureRegister</pValue></Integer>
"""


def extended(xml: str) -> str:
    """Return the list with 10 and 12 bits, automatic exposure, mirroring, gamma and a thermometer; no binning."""
    entries = "".join(
        f'<EnumEntry Name="{name}" NameSpace="Standard"><Value>{code}</Value></EnumEntry>'
        for name, code in FORMATS.items()
        if f'<EnumEntry Name="{name}"' not in xml
    )
    first = re.search(r'<EnumEntry Name="Mono16"', xml)
    last = xml.rindex("</RegisterDescription>")
    if first is None:
        raise ValueError("the library's list of features is not the one of libaravis 0.8")
    added = (
        _EXPOSURE_AUTO
        + _REGISTER.format(name="ExposureAuto", address=EXPOSURE_AUTO, access="RW")
        + _SWITCH.format(name="ReverseX")
        + _REGISTER.format(name="ReverseX", address=REVERSE_X, access="RW")
        + _SWITCH.format(name="GammaEnable")
        + _REGISTER.format(name="GammaEnable", address=GAMMA, access="RW")
        + _TEMPERATURE
        + _REGISTER.format(name="DeviceTemperature", address=TEMPERATURE_TENTHS_C, access="RO")
    )
    whole = xml[: first.start()] + entries + xml[first.start() : last] + added + xml[last:]
    return whole.replace("<Max>16</Max>", "<Max>1</Max>").replace("<Min>10.0</Min>", "<Min>1.0</Min>")
