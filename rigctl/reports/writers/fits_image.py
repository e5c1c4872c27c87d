"""A computed image as FITS: unit, content, rows from the top, checksum."""

import io

import numpy as np
from astropy.io import fits
from numpy.typing import NDArray

from rigctl.version import VERSION


def fits_image(image: NDArray[np.generic], *, unit: str, what: str) -> bytes:
    """Return an image, or a stack of them, as the bytes of a FITS file.

    Parameters
    ----------
    image : (..., H, W) array
        First row on top.
    unit : str
        Of the samples; empty for none.
    what : str
        What the samples are, up to 60 characters or so.
    """
    hdu = fits.PrimaryHDU(image)
    hdu.header["BUNIT"] = (unit, "unit of the samples")
    hdu.header["ROWORDER"] = ("TOP-DOWN", "first row is the top of the picture")
    hdu.header["CONTENT"] = what
    hdu.header["SWVER"] = f"rigctl {VERSION}"
    buffer = io.BytesIO()
    hdu.writeto(buffer, checksum=True)
    return buffer.getvalue()
