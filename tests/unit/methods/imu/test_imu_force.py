"""What the specific force of an inertial unit needs beside its knots, from the findings of a run."""

import numpy as np
import pytest

from bench.methods.imu.reduction.user_models import force_terms
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Finding, Subject

AXES = "xyz"


def finding(quantity: str, value: float, u: float = 1e-6, **at: object) -> Finding:
    return Subject("imu", "a", "IMU-7").finding(quantity, "", value, "1", [BudgetLine("all", "B", u)], at, ())


def visit(number: int, quadratic: float, misalignment: float, u: float = 1e-6) -> list[Finding]:
    return [
        finding("K2", quadratic, u, axis="x", visit=number),
        finding("misalignment", misalignment, 2 * u, axis="x", toward="y", visit=number),
        finding("misalignment", -misalignment, 3 * u, axis="x", toward="z", visit=number),
        finding("K2", 9.0, axis="y", visit=number),  # of another axis
    ]


def test_terms_are_means_over_the_visits_and_so_are_the_shares_of_an_error_common_to_them():
    terms = force_terms(0, [*visit(1, 1e-5, 2e-3), *visit(2, 3e-5, 4e-3, u=5e-6)])
    assert terms is not None
    assert (terms.quadratic.value, terms.quadratic.u) == pytest.approx((2e-5, 3e-6))
    assert {name: (each.value, each.u) for name, each in terms.cross.items()} == {
        "acc_y": pytest.approx((3e-3, 6e-6)),
        "acc_z": pytest.approx((-3e-3, 9e-6)),
    }
    assert (terms.bias_u_g, terms.scale_u, terms.valid_g) == (0, 0, (-1, 1))


def test_the_uncertainty_of_a_mean_is_what_drawn_errors_give_it():
    """At two of four visits readings are left out, so that another error of the table has a share; scatter is new."""
    draws = np.random.default_rng(4)
    shares = {"orthogonality": [0.0, 2e-5, 2e-5, 0.0], "zero": [1e-5, 1e-5, 0.0, 1e-5]}
    scatter_u = 8e-6

    def at(number: int, quantity: str) -> Finding:
        lines = [BudgetLine(name, "B", each[number]) for name, each in shares.items() if each[number]]
        lines.append(BudgetLine("scatter", "A", scatter_u))
        return Subject("imu", "a", "IMU-7").finding(quantity, "", 0.0, "1", lines, {"axis": "x", "toward": "y"}, ())

    other = [finding("misalignment", 0.0, axis="x", toward="z")]
    terms = force_terms(0, [at(n, quantity) for n in range(4) for quantity in ("K2", "misalignment")] + other)
    assert terms is not None
    errors = draws.standard_normal((4000, 2)) @ np.array(list(shares.values()))
    means = (errors + scatter_u * draws.standard_normal((4000, 4))).mean(axis=1)
    assert terms.quadratic.u == pytest.approx(np.std(means), rel=0.03)
    assert terms.cross["acc_y"].u == terms.quadratic.u


def test_what_differs_between_visits_and_between_knots_is_uncertain():
    of_run = [
        finding("K0/repeatability", 3e-5, axis="x"), finding("K0/interpolation", 1.6e-4, axis="x"),
        finding("K1/interpolation", 8e-6, axis="x"), finding("K0/repeatability", 1.0, axis="y"),
    ]  # fmt: skip
    terms = force_terms(0, [*visit(1, 1e-5, 2e-3), *of_run])
    assert terms is not None
    assert terms.bias_u_g == pytest.approx(np.hypot(3e-5, 4e-5) / np.sqrt(3))
    assert terms.scale_u == pytest.approx(2e-6 / np.sqrt(3))


def test_without_cross_coupling_there_are_no_terms():
    assert force_terms(0, visit(1, 1e-5, 2e-3)[:2]) is None
    assert force_terms(2, visit(1, 1e-5, 2e-3)) is None
