"""Instruments: identity, calibration, errors and holders of those of a bench; calibrations of all benches."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Query

from bench.clock import wall_utc
from bench.station.instruments.calibrations import CalibrationView, all_calibrations
from bench.station.instruments.view import BenchInstruments, bench_instruments
from bench.web.access import Reader
from bench.web.services import Services, Station

router = APIRouter(prefix="/api/v1", tags=["instruments"])
Days = Annotated[int | None, Query(ge=0, le=36500, description="only those due within these days, or past due")]


@router.get("/benches/{bench}/instruments")
async def instruments(station: Station, _: Reader, bench: str) -> BenchInstruments:
    """Return the instruments of a bench, as the last runs have found them, and who holds it."""
    return await instruments_of(station, bench)


@router.get("/calibrations")
async def calibrations(station: Station, _: Reader, within_days: Days = None) -> list[CalibrationView]:
    """Return the calibrations of the instruments of all benches, the next one due first."""
    found = await asyncio.to_thread(all_calibrations, station.daemon, wall_utc())
    return [each for each in found if within_days is None or each.left_days <= within_days]


async def instruments_of(station: Services, bench: str) -> BenchInstruments:
    """Return the instruments of a bench. Raises InputError if the station does not have it."""
    return await asyncio.to_thread(bench_instruments, station.daemon, bench, wall_utc())
