"""Files of pages: style, scripts and pictures, each at an address that changes with its content."""

from __future__ import annotations

import asyncio
import gzip
import hashlib
from functools import lru_cache
from pathlib import Path

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import FileResponse, Response

from bench.web.access import OPEN
from bench.web.assets import HERE

router = APIRouter(include_in_schema=False, dependencies=[OPEN])
FOLDER = HERE / "static"
TYPES = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
COMPRESSED_BYTES = 20_000  # from this size on; without a secret in it, a compressed file tells nothing
FOR_A_YEAR = {"cache-control": "public, max-age=31536000, immutable"}


@lru_cache
def static(name: str) -> str:
    """Return the address of a file, relative to the root of the station."""
    path = FOLDER / name
    version = hashlib.sha256(path.read_bytes()).hexdigest()[:12] if path.is_file() else "lacking"
    return f"/static/{name}?v={version}"


@router.get("/static/{name:path}")
async def file(request: Request, name: str) -> Response:
    """Return a file."""
    path = _files().get(name)
    if path is None:
        raise HTTPException(404, "there is no such file")
    kind = TYPES[path.suffix]
    if path.stat().st_size < COMPRESSED_BYTES or "gzip" not in request.headers.get("accept-encoding", ""):
        return FileResponse(path, media_type=kind, headers=FOR_A_YEAR)
    content = await asyncio.to_thread(compressed, path)
    headers = {**FOR_A_YEAR, "content-encoding": "gzip", "vary": "accept-encoding"}
    return Response(content, media_type=kind, headers=headers)


@lru_cache
def compressed(path: Path) -> bytes:
    """Return a file compressed by gzip."""
    return gzip.compress(path.read_bytes(), mtime=0)


@lru_cache
def _files() -> dict[str, Path]:
    """Return all files by name, so that no name in a request becomes a path."""
    found = (path for path in FOLDER.rglob("*") if path.suffix in TYPES)
    return {path.relative_to(FOLDER).as_posix(): path for path in found}
