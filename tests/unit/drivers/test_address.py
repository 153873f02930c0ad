"""Addresses of instruments: what each spelling means, and what is said of one that means nothing."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.transport.address import Address, AddressError

EXAMPLES = "expected one like tcp://192.168.1.10:502 or serial:///dev/ttyUSB0?baud=9600"
A_TCP = "is not a tcp address; expected one like tcp://192.168.1.10:502"
A_SERIAL = "is not a serial address; expected one like serial:///dev/ttyUSB0?baud=9600"
A_SERVER = "is not a socketcand address; expected one like socketcand://192.168.1.30:29536/can0"
A_LOG = "is not a log address; expected one like log:recorded/bus.blf"
A_CAN = "is not a can address; expected one like can:socketcan/can0?bitrate=500000"


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("tcp://192.168.1.10:502", Address("tcp", host="192.168.1.10", port=502)),
        ("tcp://chamber_2.lab-a.example:1", Address("tcp", host="chamber_2.lab-a.example", port=1)),
        ("tcp://localhost:65535", Address("tcp", host="localhost", port=65535)),
        ("tcp://[::1]:8000", Address("tcp", host="::1", port=8000)),
        ("tcp://[fe80::1:2]:8000", Address("tcp", host="fe80::1:2", port=8000)),
        ("sim+tcp://127.0.0.1:502", Address("tcp", host="127.0.0.1", port=502, simulated=True)),
        ("socket://192.168.1.20:4001", Address("socket", host="192.168.1.20", port=4001)),
        ("sim+socket://h:10001?baud=9600", Address("socket", "h", 10001, options={"baud": "9600"}, simulated=True)),
        ("serial:///dev/ttyUSB0", Address("serial", path="/dev/ttyUSB0")),
        ("serial:///dev/ttyUSB0?baud=9600", Address("serial", path="/dev/ttyUSB0", options={"baud": "9600"})),
        (
            "serial:///dev/ttyS0?baud=19200&bytesize=7&parity=E&stopbits=2&flow=rtscts",
            Address(
                "serial",
                path="/dev/ttyS0",
                options={"baud": "19200", "bytesize": "7", "parity": "E", "stopbits": "2", "flow": "rtscts"},
            ),
        ),
        (
            "serial:///dev/serial/by-id/usb-FTDI_FT232R USB-if00",
            Address("serial", path="/dev/serial/by-id/usb-FTDI_FT232R USB-if00"),
        ),
        (
            "slcan:///dev/ttyACM0?bitrate=500000&baud=115200",
            Address("slcan", path="/dev/ttyACM0", options={"bitrate": "500000", "baud": "115200"}),
        ),
        (
            "sim+slcan:///tmp/itb/can?bitrate=500000",
            Address("slcan", path="/tmp/itb/can", options={"bitrate": "500000"}, simulated=True),
        ),
        ("can:socketcan/can0", Address("can", path="socketcan/can0")),
        ("person:operator", Address("person", path="operator")),
        ("sim+person:night_shift", Address("person", path="night_shift", simulated=True)),
        (
            "socketcand://192.168.1.30:29536/can0?bitrate=500000",
            Address("socketcand", "192.168.1.30", 29536, "can0", {"bitrate": "500000"}),
        ),
        ("sim+socketcand://[::1]:29536/vcan0.1", Address("socketcand", "::1", 29536, "vcan0.1", simulated=True)),
        ("log:bus.blf", Address("log", path="bus.blf")),
        ("log:recorded/day 1/bus.asc", Address("log", path="recorded/day 1/bus.asc")),
        ("log:///data/bus.log", Address("log", path="/data/bus.log")),
        ("can:pcan/USBBUS1?bitrate=250000", Address("can", path="pcan/USBBUS1", options={"bitrate": "250000"})),
    ],
)
def test_an_address_is_what_it_spells_and_spelled_as_it_was_written(text, address):
    assert Address.parse(text) == address
    assert str(address) == text


def test_spellings_that_mean_the_same_are_spelled_alike():
    assert str(Address.parse("tcp://h:0502")) == "tcp://h:502"
    assert str(Address.parse("serial:///dev/ttyUSB0?")) == "serial:///dev/ttyUSB0"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", f"'' is not an address; {EXAMPLES}"),
        ("192.168.1.10:502", f"'192.168.1.10:502' is not an address; {EXAMPLES}"),
        ("/dev/ttyUSB0", f"'/dev/ttyUSB0' is not an address; {EXAMPLES}"),
        ("COM3", f"'COM3' is not an address; {EXAMPLES}"),
        ("udp://h:5", f"'udp://h:5' is not an address; {EXAMPLES}"),
        ("TCP://h:5", f"'TCP://h:5' is not an address; {EXAMPLES}"),
        (" tcp://h:5", f"' tcp://h:5' is not an address; {EXAMPLES}"),
        ("sim+", f"'sim+' is not an address; {EXAMPLES}"),
        ("sim+sim+tcp://h:5", f"'sim+sim+tcp://h:5' is not an address; {EXAMPLES}"),
        ("tcp://h", f"'tcp://h' {A_TCP}"),
        ("tcp://h:", f"'tcp://h:' {A_TCP}"),
        ("tcp://:5", f"'tcp://:5' {A_TCP}"),
        ("tcp:h:5", f"'tcp:h:5' {A_TCP}"),
        ("tcp://h:5/", f"'tcp://h:5/' {A_TCP}"),
        ("tcp://h:0", f"'tcp://h:0' {A_TCP}"),
        ("tcp://h:65536", f"'tcp://h:65536' {A_TCP}"),
        ("tcp://h:٥", f"'tcp://h:٥' {A_TCP}"),
        ("tcp://h:5 ", f"'tcp://h:5 ' {A_TCP}"),
        ("tcp://h h:5", f"'tcp://h h:5' {A_TCP}"),
        ("tcp://-h:5", f"'tcp://-h:5' {A_TCP}"),
        ("tcp://user@h:5", f"'tcp://user@h:5' {A_TCP}"),
        ("tcp://::1:5", f"'tcp://::1:5' {A_TCP}"),
        ("tcp://[h]:5", f"'tcp://[h]:5' {A_TCP}"),
        (f"tcp://{'h' * 300}:5", f"'tcp://{'h' * 21}...{'h' * 26}:5' {A_TCP}"),
        ("sim+tcp://h", f"'sim+tcp://h' {A_TCP}"),
        ("serial:/dev/ttyUSB0", f"'serial:/dev/ttyUSB0' {A_SERIAL}"),
        ("serial://dev/ttyUSB0", f"'serial://dev/ttyUSB0' {A_SERIAL}"),
        ("serial:///dev/tty\nUSB0", f"'serial:///dev/tty\\nUSB0' {A_SERIAL}"),
        ("serial:///dev/ttyUSB0#1", f"'serial:///dev/ttyUSB0#1' {A_SERIAL}"),
        (
            "slcan:ttyACM0",
            "'slcan:ttyACM0' is not a slcan address; expected one like slcan:///dev/ttyACM0?bitrate=500000",
        ),
        ("can:can0", f"'can:can0' {A_CAN}"),
        ("person:", "'person:' is not a person address; expected one like person:operator"),
        ("person:A. Turner", "'person:A. Turner' is not a person address; expected one like person:operator"),
        ("socketcand://h:29536", f"'socketcand://h:29536' {A_SERVER}"),
        ("socketcand://h/can0", f"'socketcand://h/can0' {A_SERVER}"),
        ("socketcand://h:0/can0", f"'socketcand://h:0/can0' {A_SERVER}"),
        ("socketcand://h:29536/can0/1", f"'socketcand://h:29536/can0/1' {A_SERVER}"),
        ("log:", f"'log:' {A_LOG}"),
        ("log:/data/bus.blf", f"'log:/data/bus.blf' {A_LOG}"),
        ("log://data/bus.blf", f"'log://data/bus.blf' {A_LOG}"),
        ("can://socketcan/can0", f"'can://socketcan/can0' {A_CAN}"),
        ("can:socketcan/can0/1", f"'can:socketcan/can0/1' {A_CAN}"),
    ],
)
def test_what_is_not_an_address_is_refused_with_one_that_is(text, problem):
    with pytest.raises(AddressError) as caught:
        Address.parse(text)
    assert str(caught.value) == problem


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("tcp://h:5?baud=1", "'tcp://h:5?baud=1' has an unknown option 'baud'; none is known here"),
        ("serial:///dev/x?boud=1", "'serial:///dev/x?boud=1' has an unknown option 'boud'; did you mean 'baud'?"),
        ("can:a/b?baud=1", "'can:a/b?baud=1' has an unknown option 'baud'; expected bitrate"),
        (
            "serial:///dev/x?&",
            "'serial:///dev/x?&' has an unknown option ''; expected baud, bytesize, parity, stopbits, flow or rs485",
        ),
        ("serial:///dev/x?baud=1&baud=2", "'serial:///dev/x?baud=1&baud=2' has the option 'baud' twice"),
        ("serial:///d?baud", "'serial:///d?baud': the option 'baud' cannot be ''; expected a whole number"),
        ("serial:///d?baud=9k6", "'serial:///d?baud=9k6': the option 'baud' cannot be '9k6'; expected a whole number"),
        ("serial:///d?baud=0", "'serial:///d?baud=0': the option 'baud' cannot be '0'; expected a whole number"),
        ("serial:///d?baud=٥", "'serial:///d?baud=٥': the option 'baud' cannot be '٥'; expected a whole number"),
        ("slcan:///d?bitrate=123456789", "'slcan:///d?bitrate=123456789': the option 'bitrate' cannot be '123456789'; "
                                         "expected a whole number"),
        ("serial:///d?parity=e", "'serial:///d?parity=e': the option 'parity' cannot be 'e'; did you mean 'E'?"),
        ("serial:///d?bytesize=9", "'serial:///d?bytesize=9': the option 'bytesize' cannot be '9'; "
                                   "expected 5, 6, 7 or 8"),
        ("serial:///d?stopbits=1.5", "'serial:///d?stopbits=1.5': the option 'stopbits' cannot be '1.5'; "
                                     "expected 1 or 2"),
        ("serial:///d?flow=xonxof", "'serial:///d?flow=xonxof': the option 'flow' cannot be 'xonxof'; "
                                    "did you mean 'xonxoff'?"),
    ],
)  # fmt: skip
def test_an_option_that_a_wire_does_not_take_is_refused_with_those_it_takes(text, problem):
    with pytest.raises(AddressError) as caught:
        Address.parse(text)
    assert str(caught.value) == problem


def test_a_person_is_no_wire():
    person, wire = Address.parse("person:operator"), Address.parse("tcp://h:5")
    assert person.is_person
    assert (wire.is_person, person.is_local, person.is_serial_line) == (False, False, False)


def test_an_option_that_is_not_given_has_a_default():
    address = Address.parse("serial:///dev/ttyUSB0?baud=19200&parity=N")
    assert address.option("baud", 9600) == 19200
    assert address.option("bytesize", 8) == 8
    with pytest.raises(AddressError) as caught:
        address.option("parity", 0)
    assert str(caught.value) == "serial:///dev/ttyUSB0?baud=19200&parity=N: 'parity=N' is not a whole number"


@pytest.mark.parametrize(
    ("text", "is_local"),
    [
        ("tcp://127.0.0.1:502", True),
        ("tcp://localhost:502", True),
        ("tcp://[::1]:502", True),
        ("tcp://192.168.1.10:502", False),
        ("tcp://localhost.example:502", False),
        ("serial:///tmp/itb/source", True),
        ("slcan:///tmp/itb/can", True),
        ("serial:///dev/ttyUSB0", False),
        ("serial:///dev/pts/3", False),
        ("can:socketcan/can0", False),
    ],
)
def test_loopback_and_files_outside_dev_are_this_machine_itself(text, is_local):
    assert Address.parse(text).is_local is is_local


def test_the_same_place_can_be_simulated():
    real = Address.parse("tcp://127.0.0.1:502")
    assert not real.simulated
    assert str(real.as_simulated()) == "sim+tcp://127.0.0.1:502"
    assert real.as_simulated().as_simulated() == real.as_simulated()


PIECES = st.sampled_from(
    ["sim+", "tcp:", "serial:", "slcan:", "can:", "//", "/", "[", "]", "::1", "h", ":", "502", "?", "baud", "=", "&",
     "9600", "/dev/x", "parity=E", "socketcan", "\n", "#", " "]
)  # fmt: skip


@settings(max_examples=500, deadline=None)
@given(st.text(max_size=30) | st.lists(PIECES, max_size=9).map("".join))
def test_any_text_is_an_address_that_reads_back_or_a_refusal_on_one_line(text):
    problem = ""
    try:
        address = Address.parse(text)
        assert Address.parse(str(address)) == address
    except AddressError as refused:
        problem = str(refused)
    assert len(problem.splitlines()) <= 1
