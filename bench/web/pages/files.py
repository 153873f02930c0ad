"""Files of pages: style, scripts and pictures, each at an address that changes with its content."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

from fastapi import APIRouter, HTTPException
from fastapi.responses import FileResponse

from bench.web.access import OPEN
from bench.web.assets import HERE

router = APIRouter(include_in_schema=False, dependencies=[OPEN])
FOLDER = HERE / "static"
TYPES = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
FOR_A_YEAR = {"cache-control": "public, max-age=31536000, immutable"}


@lru_cache
def static(name: str) -> str:
    """Return the address of a file, relative to the root of the station."""
    path = FOLDER / name
    version = hashlib.sha256(path.read_bytes()).hexdigest()[:12] if path.is_file() else "lacking"
    return f"/static/{name}?v={version}"


@router.get("/static/{name:path}")
async def file(name: str) -> FileResponse:
    """Return a file."""
    path = _files().get(name)
    if path is None:
        raise HTTPException(404, "there is no such file")
    return FileResponse(path, media_type=TYPES[path.suffix], headers=FOR_A_YEAR)


@lru_cache
def _files() -> dict[str, Path]:
    """Return all files by name, so that no name in a request becomes a path."""
    found = (path for path in FOLDER.rglob("*") if path.suffix in TYPES)
    return {path.relative_to(FOLDER).as_posix(): path for path in found}
