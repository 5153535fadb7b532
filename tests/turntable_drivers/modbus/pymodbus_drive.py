"""Three drives that nobody of this project's C++ code knows: python3-pymodbus serves the registers of plain_map_text() (twin_station.h),
motion is worked out here, in real time. Usage: pymodbus_drive.py tcp|rtu PORT   (rtu: RTU frames over a TCP port, for socat)"""
import asyncio
import logging
import struct
import sys
import time

from pymodbus.datastore import ModbusSequentialDataBlock, ModbusServerContext, ModbusSlaveContext
from pymodbus.server import StartAsyncTcpServer
from pymodbus.transaction import ModbusRtuFramer, ModbusSocketFramer


def signed(high, low):
    return struct.unpack(">i", struct.pack(">HH", high, low))[0]


def words(value):
    return list(struct.unpack(">HH", struct.pack(">i", int(round(value)))))


class Drive(ModbusSequentialDataBlock):
    """Counts, counts per second; the profile is a trapezoid."""

    def __init__(self, home_counts):
        super().__init__(0, [0] * 0x400)
        self.home_counts = home_counts
        self.start, self.target, self.rate, self.acceleration, self.began = 0.0, 0.0, 1.0, 1.0, 0.0
        self.enabled, self.homed, self.homing = False, False, False

    def now(self):
        """Position and rate."""
        way = self.target - self.start
        sign = 1.0 if way >= 0.0 else -1.0
        way = abs(way)
        a = self.acceleration
        v = min(self.rate, (way * a) ** 0.5) if way > 0.0 else 0.0
        t = time.monotonic() - self.began
        if v == 0.0:
            return self.target, 0.0
        ramp, cruise = v / a, (way - v * v / a) / v
        if t >= 2.0 * ramp + cruise:
            return self.target, 0.0
        if t < ramp:
            gone, speed = 0.5 * a * t * t, a * t
        elif t < ramp + cruise:
            gone, speed = 0.5 * v * ramp + v * (t - ramp), v
        else:
            left = 2.0 * ramp + cruise - t
            gone, speed = way - 0.5 * a * left * left, a * left
        return self.start + sign * gone, sign * speed

    def go(self, target, rate, acceleration):
        self.start = self.now()[0]
        self.target, self.rate, self.acceleration, self.began = target, rate, acceleration, time.monotonic()

    def getValues(self, address, count=1):
        position, rate = self.now()
        moving = rate != 0.0
        if self.homing and not moving:
            self.homing, self.homed = False, True
        status = 0x8040 | (1 if self.enabled else 0) | (0 if moving else 2) | (8 if moving else 0) | (0x10 if self.homed else 0)
        super().setValues(0x100, words(position) + words(rate) + [0, status])
        return super().getValues(address, count)

    def setValues(self, address, values):
        super().setValues(address, values)
        for i, value in enumerate(values):
            self.written(address + i, value)

    def written(self, register, value):
        if register == 0x200:
            self.enabled = value == 1
        elif register == 0x201 and value == 1:
            self.homed, self.homing = False, True
            self.go(self.home_counts, 400000.0, 1000000.0)
        elif register in (0x202, 0x203) and value == 1:
            self.start = self.target = self.now()[0]
            self.enabled = self.enabled and register == 0x202
        elif register == 0x216 and value == 1 and self.enabled:
            block = super().getValues(0x210, 6)
            self.go(signed(*block[0:2]), signed(*block[2:4]), signed(*block[4:6]))


async def main():
    drives = {1: Drive(0), 2: Drive(0), 3: Drive(-125000)}
    slaves = {unit: ModbusSlaveContext(hr=drive, zero_mode=True) for unit, drive in drives.items()}
    framer = ModbusSocketFramer if sys.argv[1] == "tcp" else ModbusRtuFramer
    await StartAsyncTcpServer(
        context=ModbusServerContext(slaves=slaves, single=False), address=("127.0.0.1", int(sys.argv[2])), framer=framer
    )


logging.disable(logging.ERROR)  # it calls a closed connection an error
asyncio.run(main())
