"""What a bench file pins of an instrument is compared, or is known not to be told: never silently passed over."""

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from campaigns.swaps.kinds import KINDS, Kind
from campaigns.swaps.panel import Panel
from drivers.description import IdentityPin
from drivers.errors import WrongIdentity
from drivers.transport.address import Address

OTHER = "other"


@pytest.mark.parametrize("what", ["maker", "model", "serial", "firmware"])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_another_name_than_the_pinned_one_is_refused_unless_it_is_only_stated(kind: Kind, what: str) -> None:
    async def main() -> None:
        panel, address = Panel(), Address.parse(kind.address)
        panel.put("device", kind.instrument(0), address)
        try:
            async with kind.driver_on(panel, "device", address, IdentityPin(**{what: OTHER})) as device:
                identity = await device.identify()
        except WrongIdentity:
            pass
        else:
            assert getattr(identity, what) == OTHER, "the wire tells something else"
            assert not identity.verified or what != "serial"
        reported = [received.data for received in panel.heard if not kind.asks(received.data)]
        assert set(reported) <= {b"WAIT MODE NOWAIT\n"}  # of an Ensemble, once it is known

    run(main(), AS_FAST_AS_POSSIBLE)
