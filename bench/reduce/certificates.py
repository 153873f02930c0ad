"""Uncertainties of a bench for the reduction, from the certificates and surveys in the bench file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from bench.config.fixture import Vector
from bench.config.models import BenchFile
from bench.metrology.bench_uncertainty import (
    AxisRecord,
    BenchRecord,
    ClockRecord,
    Drift,
    SourceRecord,
    TiltPairRecord,
)
from drivers.can.sent_frames import WITH_THE_COUNTS

ARCSEC_DEG = 1 / 3600
HOUR_S = 3600.0
DRIFT_SHARE = 0.2  # of the offset's uncertainty: assumed drift in a run of a thermometer without a stated one


def bench_record(bench: BenchFile) -> BenchRecord:
    """Certificates and surveys of a bench file as standard uncertainties u = U / k."""
    counter = next((_uncertainties(bench, role) for role in bench.with_capability("pulse_counter")), {})
    gravity, level = bench.site.gravity, bench.fixture.level
    azimuth, square = bench.fixture.azimuth, bench.fixture.orthogonality
    clock = bench.site.host_clock
    thermometers = {
        name: (reading.calibration.U.offset / reading.calibration.k, reading.calibration.U.gain / reading.calibration.k)
        for name, reading in bench.readings.items()
        if reading.calibration is not None
    }
    meters = {role: _uncertainties(bench, role) for role in bench.with_capability("voltmeter")}
    return BenchRecord(
        gravity_mps2=gravity.value,
        gravity_u_mps2=gravity.U / gravity.k,
        axes={role: _axis(bench, role, points) for role, points in bench.axes.items()},
        x=bench.fixture.x,
        z=bench.fixture.z,
        level_deg=level.value * ARCSEC_DEG,
        level_u_deg=level.U / level.k * ARCSEC_DEG,
        level_drift=_drift(level.drift, level.U, level.k, ARCSEC_DEG),
        time_base_u=float(counter.get("time_base", 0.0)),
        encoder_skew_u_s=float(counter.get("encoder_skew", 0.0)),
        thermometers_u=thermometers,
        voltmeters_u={name: (float(u.get("gain", 0)), float(u.get("offset", 0))) for name, u in meters.items()},
        latitude_deg=bench.site.latitude,
        azimuth_u_deg=azimuth.U / azimuth.k * ARCSEC_DEG if azimuth is not None else 0.0,
        orthogonality_u_deg=square.U / square.k * ARCSEC_DEG if square is not None else 0.0,
        sources=dict(_sources(bench)),
        host_clock_u=clock.U / clock.k if clock is not None else 0.0,
        telemetry=next(_latching(bench), None),
        thermometer_drifts={
            name: _drift(reading.calibration.U.drift, reading.calibration.U.offset, reading.calibration.k)
            for name, reading in bench.readings.items()
            if reading.calibration is not None
        },
        tilt_pairs=tuple(
            TiltPairRecord(pair.along, pair.across, pair.skew.value, pair.skew.U / pair.skew.k)
            for pair in bench.fixture.tilt_pairs
        ),
    )


def _drift(stated: float | None, offset: float, k: float, in_unit: float = 1.0) -> Drift:
    """Drift by the certificate, else a share of the constant error (docs/decisions/0060)."""
    return Drift((DRIFT_SHARE * offset if stated is None else stated) / k * in_unit, stated is not None)


def _latching(bench: BenchFile) -> Iterator[ClockRecord]:
    """Clocks of units that send their output, where the encoder of a table is latched with it."""
    for role, entry in bench.devices.items():
        if any(encoder.channel != WITH_THE_COUNTS for encoder in entry.encoders.values()):
            u = _uncertainties(bench, role)
            yield ClockRecord("telemetry", float(u.get("time_base", 0.0)), float(u.get("encoder_skew", 0.0)))


def _sources(bench: BenchFile) -> Iterator[tuple[str, SourceRecord]]:
    """Current sources and ammeters that have a certificate."""
    for role in bench.with_capability("current_source", "ammeter"):
        if bench.devices[role].calibration is not None:
            u = _uncertainties(bench, role)
            yield role, SourceRecord(float(u["gain"]), float(u["offset"]), float(u["drift"]) / HOUR_S)


def _axis(bench: BenchFile, role: str, points: Vector) -> AxisRecord:
    known = _uncertainties(bench, role)
    return AxisRecord(
        points=points,
        zero_u_deg=float(known.get("zero", 0.0)) * ARCSEC_DEG,
        harmonics_u_deg=tuple(np.array(known.get("harmonics", ())) * ARCSEC_DEG),
        repeatability_u_deg=float(known.get("repeatability", 0.0)) * ARCSEC_DEG,
        backlash_u_deg=float(known["backlash"]) * ARCSEC_DEG if "backlash" in known else None,
        wobble_u_deg=float(known.get("wobble", 0.0)) * ARCSEC_DEG,
    )


def _uncertainties(bench: BenchFile, role: str) -> dict[str, Any]:
    """Calibrated uncertainties of a device, each divided by its k; none without a certificate."""
    calibration = bench.devices[role].calibration
    if calibration is None:
        return {}
    stated = calibration.U.model_dump()
    return {name: np.array(U) / calibration.k for name, U in stated.items() if U is not None}
