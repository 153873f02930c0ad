"""Health and metrics of the station, for monitoring."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter, Request
from fastapi.responses import Response
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4

from bench.station.health import HealthView, health
from bench.web.access import Reader
from bench.web.metrics import Metrics
from bench.web.services import Station

router = APIRouter(tags=["health"])


@router.get("/api/v1/health")
async def health_(station: Station, _: Reader) -> HealthView:
    """Return the state of all parts with their last problems, the disk and the clock."""
    return await asyncio.to_thread(health, station.daemon)


@router.get("/metrics")
async def metrics(request: Request, _: Reader) -> Response:
    """Return the metrics for Prometheus, which sends a token of scope `read`."""
    metrics_: Metrics = request.app.state.metrics
    return Response(await metrics_.exposition(), media_type=CONTENT_TYPE_PLAIN_0_0_4)
