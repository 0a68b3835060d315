"""A plain, single-threaded bus simulator that shares no code with the driver.

Usage: ``python foreign_bus.py LINK MANNER``. MANNER is whole, each, dribble, slow or echo. The simulator serves seven
STS3215. If MANNER begins with "x_", the simulator serves XL430 that do not support fast sync reads.
"""

import os
import sys
import time
import tty

IDS = range(1, 8)
STS_MODEL = (777).to_bytes(2, "little")
STS_STATE = bytes([0, 8, 0, 0, 0, 0, 120, 30])


def sts_packet(servo_id: int, data: bytes) -> bytes:
    body = bytes([servo_id, len(data) + 2, 0]) + data
    return b"\xff\xff" + body + bytes([255 - sum(body) % 256])


def sts_replies(packet: bytes) -> list[bytes]:
    code, data = packet[4], packet[5:-1]
    memory = bytearray(128)
    memory[3:5], memory[56:64] = STS_MODEL, STS_STATE
    address, size = data[:2] if len(data) > 1 else (0, 0)
    if code == 0x82:
        return [sts_packet(i, bytes(memory[address : address + size])) for i in data[2:] if i in IDS]
    if code in (1, 2, 3) and packet[2] in IDS:
        return [sts_packet(packet[2], bytes(memory[address : address + size]) if code == 2 else b"")]
    return []


def crc(data: bytes) -> bytes:
    value = 0
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x8005) & 0xFFFF if value & 0x8000 else value << 1
    return bytes([value & 255, value >> 8])


def x_packet(servo_id: int, data: bytes) -> bytes:
    head = b"\xff\xff\xfd\x00" + bytes([servo_id, len(data) + 4, 0, 0x55, 0]) + data
    return head + crc(head)


def x_memory() -> bytearray:
    memory = bytearray(256)
    memory[0:2] = (1060).to_bytes(2, "little")
    memory[11] = 3
    memory[132:136] = (2048).to_bytes(4, "little")
    memory[144:147] = bytes([120, 0, 30])
    return memory


def x_replies(packet: bytes) -> list[bytes]:
    code, data = packet[7], packet[8:-2]
    if code not in (1, 2, 3, 0x82):
        return []
    memory = x_memory()
    address, size = (int.from_bytes(data[at : at + 2], "little") for at in (0, 2))
    if code == 0x82:
        return [x_packet(i, bytes(memory[address : address + size])) for i in data[4:] if i in IDS]
    if packet[4] not in IDS:
        return []
    if code == 1:
        return [x_packet(packet[4], bytes([36, 4, 40]))]
    return [x_packet(packet[4], bytes(memory[address : address + size]) if code == 2 else b"")]


def packet_size(data: bytes, x: bool) -> int:
    return 7 + int.from_bytes(data[5:7], "little") if x else data[3] + 4


def send(master: int, replies: list[bytes], manner: str) -> None:
    if manner == "each":
        for reply in replies:
            os.write(master, reply)
    elif manner == "dribble":
        for byte in b"".join(replies):
            os.write(master, bytes([byte]))
    elif replies:
        os.write(master, b"".join(replies))


def main() -> None:
    link, manner = sys.argv[1:]
    x = manner.startswith("x_")
    manner = manner.removeprefix("x_")
    master, slave = os.openpty()  # both ends stay open in this process
    tty.setraw(slave)
    os.symlink(os.ttyname(slave), link)
    print("ready", flush=True)
    data = b""
    while True:
        heard = os.read(master, 4096)
        data += heard
        if manner == "echo":
            os.write(master, heard)
        while len(data) > 7 or (data and not x and len(data) > 5):
            size = packet_size(data, x)
            if len(data) < size:
                break
            packet, data = data[:size], data[size:]
            send(master, x_replies(packet) if x else sts_replies(packet), manner)
            if manner == "slow":
                time.sleep(0.001)


if __name__ == "__main__":
    main()
