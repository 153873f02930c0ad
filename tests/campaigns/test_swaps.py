"""Two instruments exchange their ports, 200 times; somebody else sets an instrument, 200 times."""

import pytest

from campaigns.swaps.campaign import AT_REST, AT_WORK, BEFORE, second_masters, swaps
from campaigns.swaps.kinds import KINDS
from drivers.kinds.chamber.registers import VerifiedRegisters
from drivers.kinds.source.driver import ScpiSource
from drivers.transport.dialogue import Dialogue


def test_no_command_reaches_an_instrument_that_has_taken_the_place_of_another() -> None:
    tally = swaps(200)
    assert tally.unexpected == []
    assert tally.trials == 200
    assert min(tally.outcomes[when] for when in (BEFORE, AT_REST, AT_WORK)) > 40


def test_what_somebody_else_sets_is_found_by_the_next_look() -> None:
    tally = second_masters(200)
    assert tally.unexpected == []
    assert tally.outcomes == {"found": 200}
    assert {kind.driver for kind in KINDS} >= {"watlow_f4t", "keithley_6220", "scpi_supply", "acutronic_acl"}


def test_drivers_that_do_not_ask_who_is_there_after_they_connected_again_are_caught(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    real_open, real_connect = Dialogue._open, VerifiedRegisters.connect

    async def trusting_open(self: Dialogue) -> None:
        if self not in opened:
            await real_open(self)
            opened.append(self)
            return
        self._line = await self._wires.stream(self._device, self._address, self._new_line)

    async def trusting_connect(self: VerifiedRegisters) -> None:
        if self in connected:
            await self.link.open()
            return
        connected.append(self)
        await real_connect(self)

    opened: list[Dialogue] = []
    connected: list[VerifiedRegisters] = []
    monkeypatch.setattr(Dialogue, "_open", trusting_open)
    monkeypatch.setattr(VerifiedRegisters, "connect", trusting_connect)
    reported = [sentence for sentence in swaps(2 * len(KINDS)).unexpected if " told " in sentence]
    for driver in ("watlow_f4t", "espec_p300", "keithley_6220", "scpi_supply", "acutronic_acl", "newport_xps"):
        assert any(f", {driver}" in sentence for sentence in reported), driver


def test_a_source_that_does_not_compare_its_settings_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ScpiSource, "_compare", lambda *_: None)
    unseen = second_masters(len(KINDS)).unexpected
    assert [sentence.partition(", ")[2] for sentence in unseen] == [
        "keithley_6220: nobody saw it", "yokogawa_gs200: nobody saw it",
    ]  # fmt: skip
