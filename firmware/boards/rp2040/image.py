"""Write the CRC of the second stage into an RP2040's image, and the image as a UF2 file to drop onto the board.

Run: image.py FIRMWARE.bin FIRMWARE.uf2 (the binary is changed in place)
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path

BOOT2_BYTES, FLASH = 252, 0x10000000
UF2_BYTES = 256  # of data in a block of 512
UF2_BEGIN, UF2_END, HAS_FAMILY, RP2040 = (0x0A324655, 0x9E5D5157), 0x0AB16F30, 0x2000, 0xE48BFF56


def crc32(data: bytes) -> int:
    """Return the CRC that the boot ROM computes: x^32 + x^26 + ... + 1, from ones, neither reflected nor inverted."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ (0x04C11DB7 if crc >> 31 else 0)) & 0xFFFFFFFF
    return crc


def uf2(image: bytes) -> bytes:
    """Return an image that begins at the flash's beginning as UF2."""
    parts = [image[i : i + UF2_BYTES].ljust(UF2_BYTES, b"\xff") for i in range(0, len(image), UF2_BYTES)]
    blocks = []
    for i, part in enumerate(parts):
        head = (*UF2_BEGIN, HAS_FAMILY, FLASH + i * UF2_BYTES, UF2_BYTES, i, len(parts), RP2040)
        blocks.append(struct.pack("<8I", *head) + part.ljust(476, b"\0") + struct.pack("<I", UF2_END))
    return b"".join(blocks)


def main(binary: Path, dropped: Path) -> None:
    """Change the binary and write the UF2 file."""
    image = binary.read_bytes()
    image = image[:BOOT2_BYTES] + struct.pack("<I", crc32(image[:BOOT2_BYTES])) + image[BOOT2_BYTES + 4 :]
    binary.write_bytes(image)
    dropped.write_bytes(uf2(image))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
