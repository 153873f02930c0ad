"""An ESPEC P300 with its modes as lewis's states; its air follows the set point at 50 °C in a second."""

from collections import OrderedDict

from lewis.adapters.stream import Cmd, StreamInterface
from lewis.core import approaches
from lewis.core.statemachine import State
from lewis.devices import StateMachineDevice

MODES = ("OFF", "STANDBY", "CONSTANT", "RUN")
LOWEST_C, HIGHEST_C = -40.0, 150.0
NUMBER = r"(-?\d+(?:\.\d+)?)"


class Constant(State):
    def in_state(self, dt: float) -> None:
        device = self._context
        device.air_c = approaches.linear(device.air_c, device.set_point_c, 50.0, dt)


class P300(StateMachineDevice):
    def _initialize_data(self) -> None:
        self.air_c, self.set_point_c, self.wanted = 23.1, 20.0, "RUN"

    def _get_state_handlers(self) -> dict[str, State]:
        return {mode: Constant() if mode == "CONSTANT" else State() for mode in MODES}

    def _get_initial_state(self) -> str:
        return "RUN"

    def _get_transition_handlers(self) -> OrderedDict:
        return OrderedDict(
            ((before, after), lambda after=after: self.wanted == after)
            for before in MODES for after in MODES if before != after
        )  # fmt: skip


class P300Lines(StreamInterface):
    """Lines that end with CR LF."""

    in_terminator = "\r\n"
    out_terminator = "\r\n"
    commands = {  # noqa: RUF012 - lewis's own way
        Cmd("kind", r"^TYPE\?$"),
        Cmd("programs", r"^ROM\?$"),
        Cmd("temperatures", r"^TEMP\?$"),
        Cmd("monitor", r"^MON\?$"),
        Cmd("alarms", r"^ALARM\?$"),
        Cmd("set_point", rf"^(TEMP, ?S{NUMBER})$", argument_mappings=(bytes.decode, float)),
        Cmd("power", r"^(POWER, ?(ON|OFF))$", argument_mappings=2 * (bytes.decode,)),
        Cmd("mode", r"^(MODE, ?(OFF|STANDBY|CONSTANT))$", argument_mappings=2 * (bytes.decode,)),
    }

    def kind(self) -> str:
        return "T,T,S2,160.0"

    def programs(self) -> str:
        return "P300 1.04"

    def temperatures(self) -> str:
        device = self.device
        return f"{device.air_c:.1f},{device.set_point_c:.1f},{HIGHEST_C:.1f},{LOWEST_C:.1f}"

    def monitor(self) -> str:
        return f"{self.device.air_c:.1f},,{self.device._csm.state},0"

    def alarms(self) -> str:
        return "0"

    def set_point(self, sent: str, temperature_c: float) -> str:
        if self.device._csm.state == "RUN":
            return "NA:CHB NOT READY"
        if not LOWEST_C <= temperature_c <= HIGHEST_C:
            return "NA:DATA OUT OF RANGE"
        self.device.set_point_c = temperature_c
        return f"OK:{sent}"

    def power(self, sent: str, to: str) -> str:
        self.device.wanted = "STANDBY" if to == "ON" else "OFF"
        return f"OK:{sent}"

    def mode(self, sent: str, to: str) -> str:
        self.device.wanted = to
        return f"OK:{sent}"

    def handle_error(self, request: object, error: object) -> str:
        return "NA:CMD ERR"
