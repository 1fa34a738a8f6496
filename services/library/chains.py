"""Chains identified from sampled positions and torques."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lacet.daq.errors import UsageError
from lacet.identify.chains.clipping import clipped_torques
from lacet.identify.chains.doubts import (
    Doubts,
    accounted_for,
    doubts_of,
    in_degrees,
    in_milliseconds,
    late_torques,
    noise_bias,
)
from lacet.identify.chains.effects import ExternalForce, JointEffect
from lacet.identify.chains.exchanges import exchanged_joints
from lacet.identify.chains.fit import ChainEstimate, ChainFit, fit_chain
from lacet.identify.chains.model import ChainModel
from lacet.identify.chains.ranking import ChainRanking, JointCandidate, rank_chain
from lacet.identify.chains.samples import JointSamples, Recorded
from lacet.identify.chains.scores import (
    JointScore,
    drawn_noise,
    held_out,
    measured_noise,
    noise_after_fit,
    predicted,
    scores_of,
)
from lacet.identify.chains.verdicts import ChainVerdict, failing_joints, verdict_of
from lacet.identify.multibody.chain import Chain
from lacet.identify.signals.filters import Filters
from lacet.services.library.display import html_table, shortened
from lacet.services.one_thread import one_thread
from lacet.services.render import chain_fit
from lacet.services.render.tables import table


@dataclass(frozen=True, repr=False)
class IdentifiedChain:
    """A chain with laws of its joints, fitted to sampled positions and torques.

    Returned by `lacet.identify_chain`. Printed, and shown in a notebook, as two tables: parameters with 95 % intervals
    and their grouping, and errors joint by joint beside the noise floor.

    `fitted.model.effects` are its laws; `lacet.identify.chains.effects` has all there are.

    Attributes
    ----------
    fitted : the values: base parameters, covariances, equations, residual.
    filters : of the equations.
    slowest : (f,) rate below which a joint's equation does not count [rad/s, m/s].

    Examples
    --------
    >>> import numpy as np
    >>> slide = lacet.Chain.from_table([{"j": 1, "sigma": 1}])
    >>> t = np.arange(0.0, 20.0, 0.002)
    >>> q, acceleration = np.sin(2.0 * t)[:, None], -4.0 * np.sin(2.0 * t)[:, None]
    >>> found = lacet.identify_chain(slide, q, 3.0 * (acceleration + 9.80665), t=t, effects=[])
    >>> [(one.group, round(one.value, 3)) for one in found.parameters]
    [('M1', 3.0)]
    """

    fitted: ChainFit
    filters: Filters
    slowest: NDArray[np.float64]
    _recorded: Recorded = field(repr=False)
    _samples: JointSamples = field(repr=False)
    _how: dict[str, Any] = field(repr=False)

    @property
    def parameters(self) -> tuple[ChainEstimate, ...]:
        """Base parameters that the motion determines."""
        return self.fitted.estimates

    def value(self, combination: str) -> float:
        """Value of a sum of parameters, ``"FV1"`` or ``"ZZ1 + YY2 + 0.16*M3"`` [SI]. Raises as `combination`."""
        return self.combination(combination).value

    def interval(self, combination: str) -> tuple[float, float]:
        """Its 95 % interval [SI]. Raises as `combination`."""
        one = self.combination(combination)
        return one.value - one.half, one.value + one.half

    def combination(self, text: str) -> ChainEstimate:
        """Estimate of a sum of parameters; other spellings (``Izz1``, ``mx2``, ``fv1``) are read as well.

        Raises NotIdentifiable where torques and motion do not determine the sum, KeyError for a name that there is not,
        with the nearest match, ValueError for what is no sum.
        """
        return self.fitted.combination(text)

    @cached_property
    def noise(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(f,) σ of the white noise of positions [rad, m], and of torques [N·m, N], measured in the record."""
        return measured_noise(self.fitted, self._recorded, self.filters)

    @cached_property
    def doubts(self) -> Doubts:
        """What makes the fit unsound: signs or delay of torques, exchanged joints, unit or noise of positions, wrong
        signs, few equations."""
        with one_thread():
            bias = noise_bias(self.fitted, self._recorded, self.filters, self.noise[0])
            degrees = in_degrees(self.fitted, self._recorded, self.filters, self.slowest)
            late = late_torques(self.fitted, self._recorded, self.filters)
            exchanged = exchanged_joints(self.fitted, self._recorded, self.filters, self.slowest)
            found = doubts_of(self.fitted, bias, degrees, late, exchanged)
            clipped = clipped_torques(self.fitted, self._recorded, self.filters)
            slow = in_milliseconds(self.fitted, self._recorded, self.filters, self.slowest)
        found = replace(found, in_milliseconds=slow, clipped=clipped)
        return replace(found, gaps=self._recorded.omitted(self.filters), leaps=self._recorded.leaps)

    @cached_property
    def _noise(self) -> NDArray[np.float64]:
        with one_thread():
            return drawn_noise(self.fitted, self._recorded, self.filters, self.noise, self.slowest)

    @cached_property
    def scores(self) -> tuple[JointScore, ...]:
        """Error of each joint on the samples fitted to, beside that of noise which is fitted to."""
        with one_thread():
            noise = noise_after_fit(self.fitted, self._noise)
        return scores_of(self.fitted, self.fitted.residual, self.fitted.measured, noise)

    @cached_property
    def held_out(self) -> tuple[JointScore, ...]:
        """Error of each joint where it was not fitted to: each fifth of the record predicted from the others.

        Its floor is what noise leaves when it is predicted from the others: in a short record the parameters' errors
        are most of it. NaN where the others do not determine all parameters.
        """
        with one_thread():
            residual, noise = held_out(self.fitted, self.filters.fit_cutoff, self._noise)
        return scores_of(self.fitted, residual, self.fitted.measured, noise)

    def predict(self, q: ArrayLike, tau: ArrayLike, **given: Any) -> tuple[JointScore, ...]:
        """Error of each joint on another record, with the same filters; arguments as in `identify_chain`.

        Its floor is the other record's noise: the errors of the parameters come on top of it, and are large where this
        record was short.
        """
        how = {**self._how, **given}
        other = Recorded.read(self.fitted.model.chain, q, tau, **how)
        samples = other.samples(other.filters(self.filters.fit_cutoff, self.filters.pre_cutoff))
        with one_thread():
            measured, modelled = predicted(self.fitted, samples)
            level = measured_noise(self.fitted, other, samples.filters)
            noise = drawn_noise(self.fitted, other, samples.filters, level, self.slowest)
        residual = np.where(np.abs(samples.qd[samples.kept]) >= self.slowest, measured - modelled, np.nan)
        return scores_of(self.fitted, residual, measured, noise)

    def rank(self, candidates: Sequence[JointEffect] | None = None) -> RankedLaws:
        """Which law of a joint is missing: each that the model lacks is tried, or the `candidates` given.

        Where the fit is unsound (`doubts`), none is named: what is tried beside it may only stand in for the cause.
        """
        with one_thread():
            ranking = rank_chain(self.fitted, self._samples, self.scores, candidates)
        doubts = self.doubts
        if (
            ranking.missing
            and not (doubts.turned or doubts.exchanged)
            and (doubts.wrong_signs or doubts.biased or doubts.late)
        ):
            doubts = accounted_for(doubts, self.with_effects(*ranking.missing).doubts, ranking.missing)
        return RankedLaws(ranking, self.scores, doubts)

    def with_effects(self, *effects: JointEffect) -> IdentifiedChain:
        """The fit again with more laws."""
        model = ChainModel.of(self.fitted.model.chain, (*self.fitted.model.effects, *effects))
        with one_thread():
            fitted = fit_chain(model, self._samples, self.slowest, bool(np.any(self.fitted.weights != 1.0)))
        return IdentifiedChain(fitted, self.filters, self.slowest, self._recorded, self._samples, self._how)

    def _tables(self) -> tuple[tuple[str, Sequence[str], list[list[str]]], tuple[str, Sequence[str], list[list[str]]]]:
        head = chain_fit.fit_head(self.fitted, self.filters.fit_cutoff, self.doubts)
        return (
            (head, chain_fit.PARAMETER_HEAD, chain_fit.parameter_rows(self.fitted)),
            ("Errors", chain_fit.SCORE_HEAD, chain_fit.score_rows(self.scores, self.held_out)),
        )

    def summary(self) -> str:
        """Both tables as text."""
        return "\n\n".join(f"{caption}\n{table(list(head), rows)}" for caption, head, rows in self._tables())

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        return shortened(self.summary())

    def _repr_html_(self) -> str:
        return "".join(html_table(*one) for one in self._tables())


@dataclass(frozen=True, repr=False)
class RankedLaws:
    """Laws of joints tried on an identified chain. Returned by `IdentifiedChain.rank`.

    Attributes
    ----------
    ranking : the values.
    scores : the joints' errors that the laws were tried on.
    doubts : what makes the fit unsound that they were tried on.
    """

    ranking: ChainRanking
    scores: tuple[JointScore, ...]
    doubts: Doubts

    @property
    def missing(self) -> tuple[JointEffect, ...]:
        """The laws found missing, in the order found; none where the fit is unsound."""
        return () if self.verdict == ChainVerdict.UNSOUND else self.ranking.missing

    @property
    def verdict(self) -> str:
        """``missing``, ``nothing missing``, ``small rest``, ``unlisted cause``, ``unsound fit`` or ``not tested``."""
        return verdict_of(self.ranking, self.scores, self.doubts).value

    @property
    def failing(self) -> tuple[JointScore, ...]:
        """The joints whose errors are above their noise floor by more than chance, the worst first."""
        return failing_joints(self.scores)

    @property
    def unlisted(self) -> Mapping[str, float]:
        """Joint → error ÷ noise floor with the laws found missing in the model, where something unlisted remains."""
        return self.ranking.unlisted

    @property
    def candidates(self) -> tuple[JointCandidate, ...]:
        """All laws tried: those missing, then the others by what they explain alone."""
        return self.ranking.candidates

    def __repr__(self) -> str:
        head, rows = (
            chain_fit.ranking_head(self.ranking, self.scores, self.doubts),
            chain_fit.ranking_rows(self.ranking, self.verdict),
        )
        return shortened(f"{head}\n{table(list(chain_fit.RANKING_HEAD), rows)}")

    def _repr_html_(self) -> str:
        rows = chain_fit.ranking_rows(self.ranking, self.verdict)
        return html_table(chain_fit.ranking_head(self.ranking, self.scores, self.doubts), chain_fit.RANKING_HEAD, rows)


def identify_chain(
    chain: Chain, q: ArrayLike, tau: ArrayLike, *, rate: float | None = None, t: ArrayLike | None = None,
    qd: ArrayLike | None = None, qdd: ArrayLike | None = None, effects: Sequence[JointEffect] | None = None,
    motors: ArrayLike | None = None, zero: ArrayLike | None = None, external: Sequence[ExternalForce] = (),
    cutoff: float | None = None, pre_cutoff: float | None = None, slowest: ArrayLike | None = None,
    robust: bool = False,
) -> IdentifiedChain:  # fmt: skip
    """Identify the parameters of a chain from sampled positions and torques of its joints.

    Weighted least squares: rates and accelerations by central differences after a zero-phase pre-filter, torques and
    columns through one parallel filter, decimated; weights of the joints from their residuals.

    Parameters
    ----------
    chain : the bodies: `Chain.from_urdf`, `load_chain`, `Chain.from_table`.
    q, tau : (N, f) positions [rad, m] and torques [N·m, N], a column for each joint that moves freely.
    rate, t : sample rate [Hz], or the samples' times (N,) [s].
    qd, qdd : rates and accelerations where they were measured.
    effects : laws of the joints; by default rotor inertia, viscous and Coulomb friction and an offset at every joint.
    motors : (f, f) matrix C, where q and tau are the motors': q_motor = C q, tau = Cᵀ tau_motor.
    zero : (f,) positions of the chain's table at which the encoders, after C, read 0 [rad, m].
    external : measured forces on bodies.
    cutoff, pre_cutoff : of the fit and of the pre-filter [Hz]. By default the fit takes what holds 99.9 % of the joint
        rates' squares, and the pre-filter five times that.
    slowest : rate(s) below which a joint's equation does not count [rad/s, m/s]: friction is no Coulomb friction there.
        By default three σ of the rate's noise.
    robust : whether seconds with large residuals count less (Huber).

    Raises UsageError for arguments that do not fit each other, NotIdentifiable when there are too few equations.

    Examples
    --------
    >>> import numpy as np
    >>> arm = lacet.Chain.from_table([{"j": 1, "alpha": "pi/2"}])
    >>> s = np.arange(0.0, 20.0, 0.002)
    >>> q = np.sin(2.0 * s)[:, None]
    >>> rate, acceleration = 2.0 * np.cos(2.0 * s)[:, None], -4.0 * q
    >>> tau = arm.inverse_dynamics(q, rate, acceleration, {"ZZ1": 0.3, "MX1": 0.5, "FV1": 0.7})
    >>> found = lacet.identify_chain(arm, q, tau, t=s)
    >>> round(found.value("ZZ1 + IA1"), 3), round(found.value("FV1"), 3)
    (0.3, 0.7)
    """
    how: dict[str, object] = {"rate": rate, "t": t, "motors": motors, "zero": zero}
    recorded = Recorded.read(chain, q, tau, rate=rate, t=t, qd=qd, qdd=qdd, motors=motors, zero=zero, external=external)
    with one_thread():
        model = ChainModel.of(chain, effects)
        filters = recorded.filters(cutoff, pre_cutoff, len(model.base.independent))
        samples = recorded.samples(filters)
        limit = _slowest(slowest, recorded, filters)
        fitted = fit_chain(model, samples, limit, robust)
    return IdentifiedChain(fitted, filters, limit, recorded, samples, {**how, "t": None, "rate": recorded.rate})


def _slowest(given: ArrayLike | None, recorded: Recorded, filters: Filters) -> NDArray[np.float64]:
    """(f,) rates below which equations do not count."""
    count = recorded.q.shape[1]
    if given is None:
        return 3.0 * recorded.rate_noise(filters, recorded.noise_of(recorded.q, True))
    limit = np.asarray(given, float)
    if limit.shape not in ((), (count,)) or not np.all(limit >= 0.0):
        raise UsageError(f"slowest must be one rate or {count} of them, found {given!r}")
    return np.broadcast_to(limit, (count,)).copy()
