"""Two-sample reference: acceleration of an accelerometer fixed to the table, from encoder increments (5.6).

Two successive increments over equal times, with a rate that is linear in time: the angle is a parabola.
"""

from __future__ import annotations

from bench.metrology.least_squares import Array


def velocity_increments(
    first_rad: Array, second_rad: Array, *, total_s: float, x_m: float, y_m: float
) -> tuple[Array, Array]:
    """Velocity increments in m/s (n,) of input axes along X and Y at (x, y) of the table over both increments.

    In the frame of the table, and exact for a linear rate; `total_s` is the time of both increments. Divided by it
    they are the mean specific force at the time between the two. On a swing of frequency f the tangential part is too
    large by 2 tan(z/2) / z with z = π f total_s.
    """
    rate_rad, change_rad = 3 * first_rad - second_rad, 2 * second_rad - 2 * first_rad
    centripetal = rate_rad**2 + 2 * rate_rad * change_rad + 4 / 3 * change_rad**2
    return (
        -(centripetal * x_m + 2 * change_rad * y_m) / total_s,
        -(centripetal * y_m - 2 * change_rad * x_m) / total_s,
    )
