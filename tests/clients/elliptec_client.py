"""The package elliptec, unchanged."""

import sys

import elliptec
from pickering import drive

rotator = elliptec.Rotator(elliptec.Controller(sys.argv[1], debug=False))
rotator.home()
drive(rotator.set_angle, rotator.get_angle)
