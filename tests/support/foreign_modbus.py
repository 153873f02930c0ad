"""Modbus servers that other people wrote, with some holding registers: `python -m tests.support.foreign_modbus`.

Arguments: which server (pymodbus or libmodbus), where (a TCP port, or a serial device), and the registers as JSON,
address → word. It serves unit 1 until it is ended; it says "ready" when it is about to.
"""

import asyncio
import ctypes
import json
import sys
from collections.abc import Mapping
from ctypes.util import find_library

from pymodbus.framer import FramerType
from pymodbus.server import StartAsyncSerialServer, StartAsyncTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

LONGEST_BYTES = 260


async def pymodbus(where: str, words: Mapping[int, int]) -> None:
    registers = [SimData(address, values=word, datatype=DataType.REGISTERS) for address, word in sorted(words.items())]
    device = SimDevice(1, simdata=registers)
    print("ready", flush=True)
    if where.isdecimal():
        await StartAsyncTcpServer(context=device, address=("127.0.0.1", int(where)))
    else:
        await StartAsyncSerialServer(context=device, framer=FramerType.RTU, port=where, baudrate=9600)


class RegisterMapping(ctypes.Structure):
    """modbus_mapping_t of libmodbus."""

    _fields_ = [
        *((name, ctypes.c_int) for name in (
            "nb_bits", "start_bits", "nb_input_bits", "start_input_bits",
            "nb_input_registers", "start_input_registers", "nb_registers", "start_registers",
        )),
        ("tab_bits", ctypes.c_void_p), ("tab_input_bits", ctypes.c_void_p),
        ("tab_input_registers", ctypes.c_void_p), ("tab_registers", ctypes.POINTER(ctypes.c_uint16)),
    ]  # fmt: skip


def libmodbus(where: str, words: Mapping[int, int]) -> None:
    """libmodbus has no server program; these are the calls of the example in its documentation."""
    library = ctypes.CDLL(find_library("modbus"))
    library.modbus_new_tcp.restype = library.modbus_new_rtu.restype = ctypes.c_void_p
    library.modbus_mapping_new.restype = ctypes.POINTER(RegisterMapping)
    mapping = library.modbus_mapping_new(0, 0, 0xFFFF, 0)
    for address, word in words.items():
        mapping.contents.tab_registers[address] = word
    query = (ctypes.c_uint8 * LONGEST_BYTES)()
    if where.isdecimal():
        context = ctypes.c_void_p(library.modbus_new_tcp(b"127.0.0.1", int(where)))
        listening = ctypes.c_int(library.modbus_tcp_listen(context, 1))
    else:
        context = ctypes.c_void_p(library.modbus_new_rtu(where.encode(), 9600, ctypes.c_char(b"N"), 8, 1))
        library.modbus_set_slave(context, 1)
        library.modbus_connect(context)
    print("ready", flush=True)
    while True:
        if where.isdecimal():
            library.modbus_tcp_accept(context, ctypes.byref(listening))
        length = 0
        while length >= 0:
            length = library.modbus_receive(context, query)
            if length > 0:
                library.modbus_reply(context, query, length, mapping)


if __name__ == "__main__":
    registers = {int(address): word for address, word in json.loads(sys.argv[3]).items()}
    if sys.argv[1] == "pymodbus":
        asyncio.run(pymodbus(sys.argv[2], registers))
    else:
        libmodbus(sys.argv[2], registers)
