"""Unpacks a picture with the image library of Allied Vision's vmbpy. Run by an interpreter that has vmbpy, not by ours.

    python vimba_unpack.py PACKED-FORMAT PLAIN-FORMAT WIDTH HEIGHT <packed >plain

Formats are the numbers of the standard. Plain samples are 16 bits, little end first, right-justified.
"""

import ctypes
import sys

from vmbpy.c_binding import vmb_image_transform as vimba


def image(memory: ctypes.Array, number: int, width: int, height: int) -> vimba.VmbImage:
    described = vimba.VmbImage()
    described.Size = ctypes.sizeof(described)
    described.Data = ctypes.addressof(memory)
    vimba.call_vmb_image_transform("VmbSetImageInfoFromPixelFormat", number, width, height, ctypes.byref(described))
    return described


def main() -> None:
    packed_format, plain_format, width, height = (int(text, 0) for text in sys.argv[1:])
    packed = ctypes.create_string_buffer(sys.stdin.buffer.read())
    plain = ctypes.create_string_buffer(2 * width * height)
    source, target = image(packed, packed_format, width, height), image(plain, plain_format, width, height)
    vimba.call_vmb_image_transform("VmbImageTransform", ctypes.byref(source), ctypes.byref(target), None, 0)
    sys.stdout.buffer.write(plain.raw)


if __name__ == "__main__":
    main()
