"""The program's version, as written into every file that it makes."""

from importlib.metadata import version

VERSION = version("rigctl")
