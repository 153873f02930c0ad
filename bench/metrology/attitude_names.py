"""Names of the 24 attitudes in which the axes of a cube are along east, north and up (equations 4.2)."""

from __future__ import annotations

from collections.abc import Mapping

# Directions of the body axes x, y and z.
ATTITUDES: Mapping[str, str] = {
    "Ax1": "UEN", "Ax2": "UNW", "Ax3": "UWS", "Ax4": "USE", "Ax5": "DNE", "Ax6": "DWN", "Ax7": "DSW", "Ax8": "DES",
    "Ay1": "EUS", "Ay2": "SUW", "Ay3": "WUN", "Ay4": "NUE", "Ay5": "NDW", "Ay6": "EDN", "Ay7": "SDE", "Ay8": "WDS",
    "Az1": "SEU", "Az2": "WSU", "Az3": "NWU", "Az4": "ENU", "Az5": "WND", "Az6": "NED", "Az7": "ESD", "Az8": "SWD",
}  # fmt: skip
