"""A payload of each run, eliminated in the run as its zeros are."""

from __future__ import annotations

import numpy as np
import pytest

from lacet.identify.effects.body.payload import Payload, middle
from lacet.identify.effects.catalogue import base_model
from lacet.identify.multibody.rigid_body import wrench
from lacet.identify.multibody.vectors import Array
from lacet.identify.regression.model import Model
from lacet.identify.regression.prepared_run import PreparedRun
from lacet.identify.regression.sensor_offsets import PayloadSpread
from lacet.identify.regression.wls import FitOptions, fit
from tests.conftest import VEHICLE

SPREAD = PayloadSpread(80.0, (0.9, 0.3, 0.4))


def test_it_is_the_solution_with_the_payloads_as_unknowns(drives: dict[str, PreparedRun]) -> None:
    """Parameters, covariance and payloads are those of the dense equations in which every payload has its columns."""
    runs = [drives[name] for name in ("sine", "liftoff")]
    found = fit(Model.of(base_model(VEHICLE, "hub")), runs, FitOptions(zeros=False, unbias=False, payload=SPREAD))
    q, own = len(found.place), 4 * len(runs)
    known = found.equations.known
    lines: list[Array] = [
        np.column_stack([np.zeros((len(known), own)), known, np.zeros(len(known))]),
        np.column_stack([np.diag(1.0 / np.tile(SPREAD.sigma, len(runs))), np.zeros((own, q + 1))]),
    ]
    for number, run in enumerate(runs):
        payload = run.columns(Payload(run.name))
        assert set(payload) == {row for row in run.rows if row.startswith("chassis.")}
        for row in run.rows:
            W = run.matrix(found.model.physics, row)[:, found.base.independent]
            block = np.zeros((len(W), own + q + 1))
            if row in payload:  # first moments about the middle between the axles
                own_columns = payload[row].T
                own_columns[:, 0] += middle(run.motion) * own_columns[:, 1]
                block[:, 4 * number : 4 * number + 4] = own_columns
            block[:, own:-1], block[:, -1] = W, run.measured[row]
            lines.append(block / found.sigma[row])
    table = np.concatenate(lines)
    lengths = np.linalg.norm(table[:, :-1], axis=0)
    R = np.linalg.qr(table[:, :-1] / lengths, mode="r")
    inverse = np.linalg.inv(R) / lengths[:, None]
    x = np.linalg.lstsq(table[:, :-1] / lengths, table[:, -1], rcond=None)[0] / lengths
    covariance = inverse @ inverse.T
    sigma = np.sqrt(np.diag(covariance))
    assert np.max(np.abs(x[own:] - found.solution) / sigma[own:]) < 1e-5
    spread = np.sqrt(np.diag(found.covariance_iid))[found.place]
    np.testing.assert_allclose(spread, sigma[own:], rtol=1e-5)
    for number, (names, priors, values) in enumerate(found.zeros):
        assert names == tuple(p.name for p in Payload(runs[number].name).parameters)
        np.testing.assert_array_equal(priors, SPREAD.sigma)
        part = slice(4 * number, 4 * number + 4)
        assert np.max(np.abs(values - x[part]) / sigma[part]) < 1e-5
        assert np.max(sigma[part] / priors) < 0.99  # the runs show how they differ


def test_its_force_is_that_of_a_point_mass_to_first_order_of_its_place(drives: dict[str, PreparedRun]) -> None:
    """Exactly so at the middle between the axles; what is missing is of the second order of the distance from it."""
    run = drives["sine"]
    body, x = run.motion.body, middle(run.motion)
    assert x == pytest.approx(np.mean([corner.position[0] for corner in VEHICLE.corners.values()]))
    missing = []
    for far in (0.0, 0.1, 0.2):
        m, r = 100.0, np.array([x + far, 0.5 * far, 0.3 * far])
        inertia = m * (r @ r * np.eye(3) - np.outer(r, r))
        values = np.array([*inertia[0], *inertia[1, 1:], inertia[2, 2], *(m * r), m])
        force, moment = wrench(body.omega, body.omega_dot, body.accel, values)
        found = Payload(run.name).force(run.motion, np.array([m, *(m * r)]))
        error = np.array([*force, *moment]) - np.array(
            [found[f"chassis.{row}"] for row in ["fx", "fy", "fz", "mx", "my", "mz"]]
        )
        missing.append(float(np.max(np.abs(error))))
    assert missing[0] < 1e-9
    assert missing[2] == pytest.approx(4.0 * missing[1], rel=1e-6)
