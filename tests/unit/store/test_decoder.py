"""Frames of a device are decoded to what its description says of its channels and encoders."""

from __future__ import annotations

import pytest

from bench.config.bench import load_bench
from bench.errors import StoreError
from bench.metrology.acquisition import Codes, Counts
from bench.store.decoder import Decoder, decoders_of
from drivers.can.frame_block import FrameBlock
from tests.support.laboratory import ROOT

EMPTY = FrameBlock.empty()


def devices(name: str):
    return load_bench(ROOT / f"config/{name}.yaml").bench.devices


def test_only_devices_that_send_frames_have_a_decoder():
    assert list(decoders_of(devices("simulated"))) == ["counter"]
    with pytest.raises(StoreError, match="the driver 'scpi_supply' describes no frames; nothing that it sent can be"):
        Decoder(devices("simulated")["supply"])


def test_counts_have_the_tick_and_the_rate_of_their_counter():
    entry = devices("simulated")["counter"]
    found = Decoder(entry).outputs(EMPTY)
    assert found.keys() == {"x", "y", "z"}
    for counts in found.values():
        assert isinstance(counts, Counts)
        assert (counts.tick_period_s, counts.max_rate_pps) == (1e-6, 256e3)
    assert Decoder(entry).scales == {}
    assert len(Decoder(entry).watches()) > 0


def test_codes_have_the_step_of_their_scale():
    entry = devices("telemetry")["telemetry"]
    decoder = Decoder(entry)
    (name, codes), *_ = decoder.outputs(EMPTY).items()
    assert isinstance(codes, Codes)
    described = entry.outputs[name]
    assert (codes.tick_period_s, codes.stuck_after, codes.averaged) == (
        described.tick_period_s, described.stuck_after, described.averaged,
    )  # fmt: skip
    assert codes.step == abs(decoder.scales[name].factor)


def test_positions_have_the_resolution_of_their_encoder():
    found = 0
    for entry in devices("table_telemetry").values():
        if entry.description.frames is not None:
            for role, positions in Decoder(entry).positions(EMPTY).items():
                encoder = entry.encoders[role]
                assert positions.resolution_deg == encoder.resolution_arcsec / 3600
                assert (positions.tick_period_s, positions.channel) == (encoder.tick_period_s, encoder.channel)
                found += 1
    assert found


def test_files_that_a_run_has_not_kept_are_named(tmp_path):
    with pytest.raises(StoreError) as found:
        Decoder(devices("simulated")["counter"], tmp_path)
    assert str(found.value).startswith(f"{tmp_path / 'if_counter.dbc'}: the frames of this run cannot be decoded (")
