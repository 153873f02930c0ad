"""Lines of a 3458A typed by hand, in both directions, and the simulated voltmeter that speaks them."""

from collections.abc import Callable

import pytest

from drivers.dialects.keysight_3458a import wire
from drivers.dialects.keysight_3458a.wire import Setting
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.meters.keysight_3458a import Simulated3458A
from simulators.instruments.meters.meter_inputs import VoltsOnLoad
from simulators.physics.voltmeter import VoltmeterSettings
from simulators.serving.serve import PatientSession
from tests.support.voltmeter import LOAD_OHM, a_world

# The driver's side


def test_what_is_sent() -> None:
    assert wire.set_up(Setting(10.0, 10.0)) == (
        b"PRESET NORM;TARM HOLD;TRIG AUTO;INBUF ON;END ALWAYS;QFORMAT NORM;DCV 10;NPLC 10;AZERO ON;TARM?"
    )
    assert b";DCV 0.1;NPLC 100;" in wire.set_up(Setting(0.1, 100.0))
    assert wire.IDENTITY_QUERY == b"TARM HOLD;END ALWAYS;ID?"
    assert wire.TRIGGER == b"TARM SGL"


def test_a_set_up_fits_into_the_input_buffer_and_asks_once() -> None:
    longest = max((wire.set_up(Setting(range_v, nplc)) for range_v in wire.RANGES_V for nplc in wire.NPLCS), key=len)
    assert len(longest) < 255
    assert longest.count(b"?") == 1


def test_what_is_sent_for_a_current() -> None:
    assert wire.set_up(Setting(1e-2, 10.0, wire.DC_CURRENT)) == (
        b"PRESET NORM;TARM HOLD;TRIG AUTO;INBUF ON;END ALWAYS;QFORMAT NORM;DCI 0.01;NPLC 10;AZERO ON;TARM?"
    )
    assert b";DCI 1E-07;NPLC 100;" in wire.set_up(Setting(1e-7, 100.0, wire.DC_CURRENT))


@pytest.mark.parametrize(("answer", "range_a"), [(b"6, .01\r", 1e-2), (b"6, 100.000000E-09\r", 1e-7), (b"6, 1\r", 1.0)])
def test_a_current_is_told_by_its_function(answer: bytes, range_a: float) -> None:
    assert wire.read_numbers(answer) == wire.state_when(Setting(range_a, 10.0, wire.DC_CURRENT))[b"FUNC?"]


def test_the_state_is_asked_one_question_after_the_other() -> None:
    answers = {
        b"TARM?": b"4\r", b"FUNC?": b"1, .1\r", b"NPLC?": b"10.0000000E+00\r", b"AZERO?": b"1\r", b"MATH?": b"0\r",
        b"INBUF?": b"1\r",
    }  # fmt: skip
    assert {question: wire.read_numbers(answer) for question, answer in answers.items()} == wire.state_when(
        Setting(0.1, 10.0)
    )


@pytest.mark.parametrize(
    ("line", "volts"),
    [
        (b"-1.234567890E-01\r", -0.123456789),
        (b" 1.000000000E+01\r", 10.0),
        (b"+9.99999E+00", 9.99999),
        (b"-1.000000000E+38\r", -wire.OVERLOAD),
        (b"1E+38", wire.OVERLOAD),
    ],
)
def test_a_reading_is_read(line: bytes, volts: float) -> None:
    assert wire.read_number(line) == volts


@pytest.mark.parametrize(
    "line", [b"", b"HP3458A\r", b"1.0,2.0", b"nan", b"inf", b"1_0", b"0x10", b"1.0 V", b".", "½".encode()]
)
def test_anything_else_is_no_reading(line: bytes) -> None:
    with pytest.raises(ValueError, match=r"number|ascii"):
        wire.read_number(line)


@pytest.mark.parametrize(
    ("line", "maker"), [(b"HP3458A\r", "HP"), (b"Keysight 3458A\r", "Keysight"), (b"AGILENT 3458A", "AGILENT")]
)
def test_the_identity_is_read(line: bytes, maker: str) -> None:
    identity = wire.read_identity(line)
    assert (identity.maker, identity.model, identity.serial, identity.verified) == (maker, "3458A", "", False)


@pytest.mark.parametrize("line", [b"HP3457A\r", b"KEITHLEY INSTRUMENTS INC.,MODEL 2002,1,A02", b"1.0E+00", b""])
def test_another_instrument_is_no_3458a(line: bytes) -> None:
    with pytest.raises(ValueError, match="not a 3458A"):
        wire.read_identity(line)


@pytest.mark.parametrize(
    ("line", "code", "text", "own"),
    [
        (b'0,"NO ERROR"\r', 0, "NO ERROR", False),
        (b'102,"TRIGGER TOO FAST"\r', 102, "TRIGGER TOO FAST", False),
        (b'106, "PARAMETER OUT OF RANGE"\r', 106, "PARAMETER OUT OF RANGE", False),
        (b'109,"OUT OF CALIBRATION"\r', 109, "OUT OF CALIBRATION", True),
        (b'201,"SLAVE PROCESSOR NOT RESPONDING"\r', 201, "SLAVE PROCESSOR NOT RESPONDING", True),
    ],
)
def test_an_error_is_read_and_known_for_what_it_is(line: bytes, code: int, text: str, own: bool) -> None:
    entry = wire.read_error(line)
    assert (entry.code, entry.text, wire.is_own_fault(entry)) == (code, text, own)


@pytest.mark.parametrize("line", [b"0", b"NO ERROR", b'"NO ERROR",0', b""])
def test_anything_else_is_no_error(line: bytes) -> None:
    with pytest.raises(ValueError, match="not an entry"):
        wire.read_error(line)


@pytest.mark.parametrize(("nplc", "duration_s", "middle_s"), [(1, 0.04, 0.03), (10, 0.4, 0.3), (100, 4.0, 2.1)])
def test_how_long_a_reading_takes_and_when_its_middle_was(nplc: float, duration_s: float, middle_s: float) -> None:
    assert wire.duration_s(nplc, 50.0) == pytest.approx(duration_s)
    assert wire.middle_before_answer_s(nplc, 50.0) == pytest.approx(middle_s)


# The simulator's side


class Bench:
    """A simulated voltmeter whose clock the test turns."""

    def __init__(self, **settings: float) -> None:
        self.now_s = 0.0
        self.faults = FaultPlan(now_s=lambda: self.now_s)
        self.world = a_world(lambda: self.now_s)
        line_hz = settings.pop("line_hz", 50.0)
        on_load = VoltsOnLoad(self.world, VoltmeterSettings("a", LOAD_OHM, **settings), "voltmeter")
        self.meter = Simulated3458A(self.world, self.faults, on_load, line_hz=line_hz)
        self.session = self.meter.session()
        self.session.answer_by(lambda delay_s, answer: self.due.append((self.now_s + delay_s, answer)))
        self.due: list[tuple[float, Callable[[], bytes]]] = []

    def say(self, *lines: bytes) -> list[bytes]:
        return [self.session.feed(line + b"\n") for line in lines]

    def wait(self) -> bytes:
        """Until the reading is there; what is said then."""
        self.now_s, answer = self.due.pop(0)
        return answer()


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.say(b"END ALWAYS;TARM HOLD")
    return bench


def test_a_session_with_a_voltmeter(bench: Bench) -> None:
    assert isinstance(bench.session, PatientSession)
    assert bench.say(b"ID?", b"ERRSTR?") == [b"HP3458A\r\n", b'0,"NO ERROR"\r\n']
    assert bench.say(wire.set_up(Setting(0.1, 10.0))) == [b"4\r\n"]
    assert bench.say(b"FUNC?", b"RANGE?", b"NPLC?", b"azero?", b"END?", b"INBUF?", b"OFORMAT?") == [
        b"1, .1\r\n", b".1\r\n", b"10.0000000E+00\r\n", b"1\r\n", b"2\r\n", b"1\r\n", b"1\r\n",
    ]  # fmt: skip
    assert bench.say(b"DCV 12", b"RANGE?", b"DCV 12.1", b"RANGE?", b"DCV,1", b"RANGE?") == [
        b"", b"10\r\n", b"", b"100\r\n", b"", b"1\r\n",
    ]  # fmt: skip


def test_without_end_no_answer_passes_the_gateway() -> None:
    bench = Bench()
    assert bench.say(b"ID?", b"END ALWAYS;ID?") == [b"", b"HP3458A\r\n"]


def test_a_reading_takes_twice_its_line_cycles_and_holds_the_trigger(bench: Bench) -> None:
    bench.say(b"PRESET NORM;DCV 1;NPLC 10;TRIG AUTO")
    assert bench.say(b"TARM?", b"TARM SGL", b"TARM?") == [b"1\r\n", b"", b""]
    assert bench.wait() == b" 5.000000000E-01\r\n4\r\n"
    assert bench.now_s == pytest.approx(0.4)


def test_bytes_come_in_any_portions_and_a_cr_ends_a_command_too(bench: Bench) -> None:
    assert [bench.session.feed(part) for part in (b"ID", b"?\r\nTAR", b"M?\r\n")] == [b"", b"HP3458A\r\n", b"4\r\n"]


@pytest.mark.parametrize(
    ("messages", "answer"),
    [
        (b"NPLC .5", b"500.000000E-03"), (b"NPLC 1", b"1.00000000E+00"), (b"NPLC 2.5", b"3.00000000E+00"),
        (b"NPLC 11", b"20.0000000E+00"), (b"NPLC 100", b"100.000000E+00"), (b"NPLC 0", b"0.00000000E+00"),
    ],
)  # fmt: skip
def test_line_cycles_are_rounded_up(bench: Bench, messages: bytes, answer: bytes) -> None:
    assert bench.say(messages, b"NPLC?") == [b"", answer + b"\r\n"]


def test_the_line_frequency_is_that_of_a_whole_number_of_clock_ticks() -> None:
    bench = Bench(line_hz=60.0)
    assert bench.say(b"END ALWAYS;LFREQ?") == [b"59.9998800E+00\r\n"]


@pytest.mark.parametrize(
    ("messages", "error"),
    [
        (b"NONSENSE", b'103,"SYNTAX ERROR"'),
        (b"*IDN?", b'103,"SYNTAX ERROR"'),
        (b"AZERO PERHAPS", b'105,"UNDEFINED PARAMETER RECEIVED"'),
        (b"NPLC ten", b'105,"UNDEFINED PARAMETER RECEIVED"'),
        (b"NPLC 1001", b'106,"PARAMETER OUT OF RANGE"'),
        (b"DCV 1200", b'106,"PARAMETER OUT OF RANGE"'),
    ],
)
def test_what_is_not_understood_sets_a_bit_that_is_read_once(bench: Bench, messages: bytes, error: bytes) -> None:
    assert bench.say(messages, messages, b"ERRSTR?", b"ERRSTR?") == [b"", b"", error + b"\r\n", b'0,"NO ERROR"\r\n']


def test_errors_of_the_hardware_come_first(bench: Bench) -> None:
    bench.meter.errors |= {103, 204, 100}
    assert [answer[:3] for answer in bench.say(*[b"ERRSTR?"] * 4)] == [b"204", b"100", b"103", b'0,"']


def test_beyond_the_range_it_reads_overload(bench: Bench) -> None:
    bench.say(b"TRIG AUTO;DCV .1;TARM SGL")
    assert bench.wait() == b" 1.000000000E+38\r\n"
    bench.world.move(180.0, 1000.0)
    bench.now_s += 10.0
    bench.say(b"TARM SGL")
    assert bench.wait() == b"-1.000000000E+38\r\n"
    bench.say(b"DCV AUTO;TARM SGL")
    assert bench.wait() == b"-5.000000000E-01\r\n"
    assert bench.say(b"FUNC?") == [b"1, 1\r\n"]


def test_its_errors_are_a_gain_and_an_offset() -> None:
    bench = Bench(gain=10e-6, offset_v=1e-6)
    bench.say(b"END ALWAYS;TRIG AUTO;TARM SGL")
    assert float(bench.wait()) == pytest.approx(0.5 * (1 + 10e-6) + 1e-6, abs=1e-9)


@pytest.mark.parametrize(("nplc", "sd_v"), [(10, 1e-6), (1, 3.16e-6), (100, 0.316e-6)])
def test_its_noise_falls_with_the_root_of_the_line_cycles(nplc: int, sd_v: float) -> None:
    bench = Bench(noise_v=1e-6)
    bench.say(f"END ALWAYS;TRIG AUTO;NPLC {nplc}".encode())
    deviations = []
    for _ in range(400):
        bench.say(b"TARM SGL")
        deviations.append(float(bench.wait()) - 0.5)
    assert (sum(deviation**2 for deviation in deviations) / 400) ** 0.5 == pytest.approx(sd_v, rel=0.15)


def test_a_reading_is_the_mean_over_its_aperture_whatever_changes_meanwhile(bench: Bench) -> None:
    bench.say(b"TRIG AUTO;NPLC 10;TARM SGL")
    bench.now_s = 0.05
    bench.world.power("supply", False)
    bench.now_s = 0.3  # the zero is being measured: what the input does now does not matter
    bench.world.power("supply", True)
    assert float(bench.wait()) == pytest.approx(0.5 * 0.05 / 0.2)


def test_a_unit_without_power_gives_nothing(bench: Bench) -> None:
    bench.world.power("supply", False)
    bench.say(b"TARM SGL")
    assert bench.wait() == b" 0.000000000E+00\r\n"


def test_faults_and_a_power_failure(bench: Bench) -> None:
    bench.say(wire.set_up(Setting(1.0, 1.0)), b"TARM SGL")
    bench.wait()
    bench.faults.begin("frozen")
    bench.world.power("supply", False)
    bench.say(b"TARM SGL")
    assert bench.wait() == b" 5.000000000E-01\r\n"
    bench.faults.begin("stuck")
    assert bench.say(b"NPLC 2;MATH NULL", b"NPLC?", b"MATH?") == [b"", b"1.00000000E+00\r\n", b"0\r\n"]
    bench.say(b"TARM SGL")
    bench.meter.restart()
    assert bench.wait() == b""
    assert bench.meter.codes["END"] == 0


def test_reset_is_as_switching_on(bench: Bench) -> None:
    bench.say(wire.set_up(Setting(1.0, 1.0)), b"MATH NULL", b"RESET", b"END ON")
    assert bench.say(b"TARM?", b"NPLC?", b"INBUF?", b"MATH?") == [b"1\r\n", b"10.0000000E+00\r\n", b"0\r\n", b"0\r\n"]


def test_a_single_trigger_reads_when_the_trigger_arm_lets_it_pass(bench: Bench) -> None:
    # As drivers of other people read it: PRESET NORM, FUNC DCV,1, NPLC, then TRIG SGL for each reading.
    bench.say(b"PRESET NORM;FUNC DCV,1;NPLC 1;TRIG SGL")
    assert float(bench.wait()) == pytest.approx(0.5)
    assert bench.say(b"TRIG?", b"TARM?") == [b"4\r\n", b"1\r\n"]
    bench.say(b"TARM HOLD;TRIG SGL")
    assert bench.due == []


def test_what_other_programs_set_and_ask_besides(bench: Bench) -> None:
    # As the package hp3458a says it.
    bench.say(b"NDIG 8;DELAY 0.5;LFILTER ON;BEEP OFF;DISP OFF;MEM FIFO;RANGE 10;NRDGS 1,AUTO")
    assert bench.say(b"NDIG?", b"DELAY?", b"LFILTER?", b"BEEP?", b"DISP?", b"MEM?", b"RANGE?") == [
        b"8\r\n", b"0.5\r\n", b"1\r\n", b"0\r\n", b"0\r\n", b"2\r\n", b"10\r\n",
    ]  # fmt: skip
    assert bench.say(b"OPT?", b"STB?") == [b"0\r\n", b"0\r\n"]
    assert float(bench.say(b"TEMP?")[0]) == 36.5
    assert bench.say(b"NDIG 9;NONSENSE;NDIG 1", b"STB?", b"ERR?", b"ERR?", b"AUXERR?") == [
        b"", b"32\r\n", b"72\r\n", b"0\r\n", b"0\r\n",
    ]  # fmt: skip


def test_the_aperture_is_another_name_for_line_cycles(bench: Bench) -> None:
    assert bench.say(b"NPLC 10", b"APER?", b"APER 0.02", b"NPLC?", b"APER 2", b"ERRSTR?") == [
        b"", b"200.000000E-03\r\n", b"", b"1.00000000E+00\r\n", b"", b'106,"PARAMETER OUT OF RANGE"\r\n',
    ]  # fmt: skip


def test_formats_and_scales_are_told(bench: Bench) -> None:
    assert bench.say(b"MFORMAT?", b"MFORMAT DINT;MFORMAT?", b"ISCALE?", b"ARANGE?", b"DCV 10;ARANGE?", b"MCOUNT?") == [
        b"4\r\n", b"3\r\n", b"1.00000000E+00\r\n", b"1\r\n", b"0\r\n", b"0\r\n",
    ]  # fmt: skip


def test_the_gateway_answers_its_own_lines(bench: Bench) -> None:
    """Prologix GPIB-ETHERNET Controller User Manual 1.6.6, chapter 8."""
    messages = (b"++mode", b"++addr", b"++auto", b"++eos 2", b"++savecfg 1", b"++read_tmo_ms 500", b"++read_tmo_ms")
    assert bench.say(*messages) == [b"1\r\n", b"22\r\n", b"1\r\n", b"", b"", b"", b"500\r\n"]
    assert bench.say(b"++ver", b"++what", b"++addr 99", b"++spoll", b"ERRSTR?") == [
        b"Prologix GPIB-ETHERNET Controller version 01.06.06.00\r\n", b"Unrecognized command\r\n",
        b"Unrecognized command\r\n", b"0\r\n", b'0,"NO ERROR"\r\n',
    ]  # fmt: skip


def test_without_reading_by_itself_the_gateway_waits_for_read(bench: Bench) -> None:
    assert bench.say(b"++auto 0", b"ID?", b"++read eoi", b"++read eoi") == [b"", b"", b"HP3458A\r\n", b""]
    bench.say(b"TRIG AUTO;NPLC 1")
    assert bench.say(b"TARM SGL", b"++read eoi") == [b"", b""]
    assert bench.wait() == b" 5.000000000E-01\r\n"


def test_what_is_said_to_another_address_does_not_reach_the_instrument(bench: Bench) -> None:
    assert bench.say(b"++addr 5", b"ID?", b"DCV 1", b"++addr 22", b"RANGE?") == [b"", b"", b"", b"", b".1\r\n"]


def test_a_reading_whose_connection_is_gone_ends_unread(bench: Bench) -> None:
    bench.session.feed(b"TARM HOLD;END ALWAYS;NPLC 100;TARM SGL\n")
    (ends_s, _answer) = bench.due[0]
    after = bench.meter.session()  # the first one is closed, and takes no answer
    assert after.feed(b"ID?\n") == b""
    bench.now_s = ends_s + 0.001
    assert after.feed(b"TARM?\n") == b"HP3458A\r\n4\r\n"
