"""What SCPI instruments share: numbers, headers, messages, and the error queue."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.protocols import scpi
from drivers.protocols.scpi import Command, ErrorEntry
from drivers.values import Identity
from simulators.instruments.scpi import POWER_ON, QUEUE_LENGTH, Interpreter, LineSession, Refusal, setting, switch

# Numbers


@pytest.mark.parametrize(
    ("text", "value"),
    [("5", 5.0), ("+1.200000E-03", 0.0012), ("-.5", -0.5), ("15.", 15.0), ("1e3", 1000.0), ("9.8E37", 9.8e37)],
)
def test_a_number_is_read(text: str, value: float) -> None:
    assert scpi.number(text) == value


@pytest.mark.parametrize(
    "text",
    ["", " 5", "5 ", "nan", "NAN", "inf", "-INF", "9.9E37", "-9.9E+37", "9.91E37", "1e999", "0x10", "1_000", "1,5",
     "5V", "٣", "--5", "1e", "."],
)  # fmt: skip
def test_what_is_not_a_finite_number_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"number|stands for"):
        scpi.number(text)


@given(st.text(max_size=12))
def test_whatever_is_read_is_finite(text: str) -> None:
    try:
        value = scpi.number(text)
    except ValueError:
        return
    assert math.isfinite(value)
    assert abs(value) < 9.9e37


@given(st.floats(-100, 100, allow_subnormal=False))
def test_a_number_comes_back_as_it_was_sent(value: float) -> None:
    assert scpi.number(scpi.spell(value)) == pytest.approx(value, rel=5e-6, abs=1e-300)


def test_switches_and_registers() -> None:
    assert scpi.boolean("1")
    assert not scpi.boolean("0")
    assert scpi.integer("-12") == -12
    for bad in ("2", "ON", "", "1 "):
        with pytest.raises(ValueError, match="neither"):
            scpi.boolean(bad)
    for bad in ("1.0", "", "1e3", "12345678901"):
        with pytest.raises(ValueError, match="whole"):
            scpi.integer(bad)


# Answers


@pytest.mark.parametrize("line", [b"5.01;0.062;1", b"5.01; 0.062; 1"])
def test_answers_of_one_message_are_taken_apart(line: bytes) -> None:
    assert scpi.answers(line, 3) == ["5.01", "0.062", "1"]


@pytest.mark.parametrize("line", [b"5.01;0.062", b"5.01;0.062;1;1", b"\xb5;0;1"])
def test_too_few_or_too_many_answers_are_refused(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"answers to 3 questions|codec"):
        scpi.answers(line, 3)


@pytest.mark.parametrize(
    ("line", "entry"),
    [
        (b'0,"No error"', ErrorEntry(0, "No error")),
        (b'-113,"Undefined header"', ErrorEntry(-113, "Undefined header")),
        (b'+802, "Output; ""blocked"""', ErrorEntry(802, 'Output; "blocked"')),
        (b'+0,"No error"', ErrorEntry(0, "No error")),
        (b'-0, "No error" ', ErrorEntry(0, "No error")),
        (b"0,'No error'", ErrorEntry(0, "No error")),
        (b"0,No error\r", ErrorEntry(0, "No error")),
    ],
)
def test_an_error_entry_is_read(line: bytes, entry: ErrorEntry) -> None:
    assert scpi.error_entry(line) == entry


@pytest.mark.parametrize("line", [b"0", b"0,0", b"0,", b'0,"No error', b'x,"No error"', b'0,"No error";1', b""])
def test_what_is_no_error_entry_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError, match="error queue"):
        scpi.error_entry(line)


def test_an_identity_is_read() -> None:
    line = b"KEITHLEY INSTRUMENTS INC.,MODEL 6220,1234567,A02  /700x"
    assert scpi.identity(line) == Identity("KEITHLEY INSTRUMENTS INC.", "MODEL 6220", "1234567", "A02  /700x")
    assert scpi.identity(b"A,B,C,1.0,boot 2").firmware == "1.0,boot 2"
    assert scpi.identity(b"A,B,,") == Identity("A", "B", "", "")  # as some supplies answer


@pytest.mark.parametrize("line", [b"", b"5.01", b"A,B,C", b"A,,C,D", b",B,C,D", b'0,"No error"'])
def test_what_is_no_identity_is_refused(line: bytes) -> None:
    with pytest.raises(ValueError, match="maker,model"):
        scpi.identity(line)


# Headers and messages


@pytest.mark.parametrize(
    ("spelled", "headers"),
    [
        ("[SOURce:]CURRent:COMPliance", ["SOUR:CURR:COMP", "SOURCE:CURRENT:COMPLIANCE", "CURR:COMP", "CURRENT:COMP"]),
        ("R?", ["R?"]),
        ("OUTPut[:STATe]?", ["OUTP?", "OUTPUT?", "OUTP:STAT?", "OUTPUT:STATE?"]),
        ("MEASure[:SCALar]:VOLTage[:DC]?", ["MEAS:VOLT?", "MEASURE:SCALAR:VOLTAGE:DC?"]),
        ("SYSTem:ERRor[:NEXT]?", ["SYST:ERR?", "SYSTEM:ERROR:NEXT?"]),
        ("*IDN?", ["*IDN?"]),
    ],
)
def test_a_header_is_known_in_its_short_and_long_forms(spelled: str, headers: list[str]) -> None:
    assert set(headers) <= set(scpi.spellings(spelled))


@pytest.mark.parametrize(
    ("spelled", "header"),
    [
        ("[SOURce:]CURRent:COMPliance", "SOUR:CURR"),
        ("[SOURce:]CURRent:COMPliance", "SOUR:CURR:COMPL"),
        ("[SOURce:]CURRent:COMPliance", "SOUR:CURR:COMP?"),
        ("OUTPut[:STATe]?", "OUTP"),
        ("OUTPut[:STATe]?", "OUTPU?"),
        ("*IDN?", "IDN?"),
        ("*CLS", "**CLS"),
        ("OUTPut[:STATe]?", "OUTP:?"),
        ("[SOURce:]CURRent:COMPliance", "SOURC:CURR:COMP"),
    ],
)
def test_other_headers_are_not(spelled: str, header: str) -> None:
    assert header not in scpi.spellings(spelled)


@pytest.mark.parametrize(
    ("message", "commands"),
    [
        ("volt 5", [Command("VOLT", "5")]),
        (":SOUR:CURR:RANG:AUTO 0;:SOUR:CURR:RANG 0.02",
         [Command("SOUR:CURR:RANG:AUTO", "0"), Command("SOUR:CURR:RANG", "0.02")]),
        ("SOUR:CURR 1E-3;CURR:COMP 10", [Command("SOUR:CURR", "1E-3"), Command("SOUR:CURR:COMP", "10")]),
        ("SOUR:CURR:RANG 1;*CLS;COMP 10",
         [Command("SOUR:CURR:RANG", "1"), Command("*CLS", ""), Command("SOUR:CURR:COMP", "10")]),
        ("status:queue:clear;*RST;:stat:pres;:*CLS;",
         [Command("STATUS:QUEUE:CLEAR", ""), Command("*RST", ""), Command("STAT:PRES", ""), Command("*CLS", "")]),
        ('DISP:TEXT "a;b" ; OUTP?', [Command("DISP:TEXT", '"a;b"'), Command("DISP:OUTP?", "")]),
        ("OUTP? ; ;", [Command("OUTP?", "")]),
        ("", []),
    ],
)  # fmt: skip
def test_a_message_is_taken_apart(message: str, commands: list[Command]) -> None:
    assert list(scpi.commands(message)) == commands


# The simulators' side


def an_interpreter() -> Interpreter:
    levels = [0.0]

    def set_level(argument: str) -> None:
        levels[0] = setting(argument, 0, 16)

    return Interpreter("A,B,C,D", {"VOLTage": set_level, "VOLTage?": lambda _: f"{levels[0]:g}"})


def test_an_interpreter_answers_a_message_in_one_line() -> None:
    interpreter = an_interpreter()
    assert interpreter.execute("VOLT 5;VOLT?;*OPC?") == "5;1"
    assert interpreter.execute("*OPC;*WAI;STAT:PRES") == ""
    assert interpreter.execute("*STB?") == "0"
    assert interpreter.execute("*IDN?") == "A,B,C,D"


def test_errors_queue_up_in_order_and_set_their_event_bits() -> None:
    interpreter = an_interpreter()
    assert interpreter.execute("*ESR?") == str(POWER_ON)
    assert interpreter.execute("VOLT 5;NONSENSE 1;VOLT x;VOLT 17;VOLT?") == "5"
    assert interpreter.execute("*STB?") == "4"
    assert interpreter.execute("*ESR?;*ESR?") == f"{1 << 5 | 1 << 4};0"
    assert interpreter.execute("SYST:ERR?") == '-113,"Undefined header"'
    assert interpreter.execute("SYST:ERR?") == '-104,"Data type error"'
    assert interpreter.execute(":SYSTEM:ERROR?;:SYST:ERR?") == '-222,"Data out of range";0,"No error"'


def test_a_full_error_queue_says_so() -> None:
    interpreter = an_interpreter()
    for _ in range(QUEUE_LENGTH + 5):
        interpreter.execute("NONSENSE")
    entries = [interpreter.execute("SYST:ERR?") for _ in range(QUEUE_LENGTH + 1)]
    assert entries[-3:] == ['-113,"Undefined header"', '-350,"Queue overflow"', '0,"No error"']
    interpreter.execute("NONSENSE;*CLS")
    assert interpreter.execute("SYST:ERR?;*ESR?") == '0,"No error";0'


def test_switch_arguments() -> None:
    assert [switch(text) for text in ("1", "on", "0", "OFF", "1.0")] == [True, True, False, False, True]
    with pytest.raises(Refusal, match="-224"):
        switch("maybe")


def test_lines_may_come_in_any_portions() -> None:
    session = LineSession(an_interpreter().execute, end=b"\r", answer_end=b"\r\n")
    answers = b"".join(session.feed(bytes([byte])) for byte in b"VOLT 5\r\n\r\nVOLT?\r")
    assert answers == b"5\r\n"
    assert session.feed(b"VOLT?\n") == b""  # this one acts on CR
    assert LineSession(an_interpreter().execute).feed(b"x" * 5000 + b"VOLT?") == b""


def test_the_status_byte_sums_up_what_is_enabled() -> None:
    interpreter = Interpreter("MAKER,MODEL,1,1", {}, summary=lambda: 128)
    assert interpreter.execute("*CLS;*ESE?;*SRE?;*STB?;*TST?") == "0;0;128;0"
    assert interpreter.execute("*ESE 32;*SRE 32;*ESE?;*SRE?;*STB?") == "32;32;128"
    assert interpreter.execute("NONSENSE;*STB?") == str(128 + 64 + 32 + 4)
    assert interpreter.execute("*ESR?;*STB?;:SYST:ERR?;*STB?") == '32;132;-113,"Undefined header";128'
    assert interpreter.execute("*SRE 256;*SRE?;:SYST:ERR?") == '32;-222,"Data out of range"'


def test_some_tell_their_errors_with_a_sign() -> None:
    interpreter = Interpreter("MAKER,MODEL,1,1", {}, signed=True)
    assert interpreter.execute("NONSENSE;:SYST:ERR?;ERR?") == '-113,"Undefined header";+0,"No error"'


def test_a_number_may_be_the_least_or_the_most() -> None:
    assert [setting(word, -2.0, 5.0) for word in ("MIN", "maximum", "3")] == [-2.0, 5.0, 3.0]
