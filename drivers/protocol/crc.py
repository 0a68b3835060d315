"""The checksum of Dynamixel protocol 2.0 is CRC-16, polynomial 0x8005, from zero, nothing reflected.

``crc16(data, value=0)``: of ``data``, behind bytes whose checksum is ``value``. It goes over the wire low byte first.
Source: ROBOTIS e-manual, "CRC calculation"; catalogues of checksums call it CRC-16/UMTS.
"""

from fastcrc.crc16 import umts as crc16

__all__ = ["crc16"]
