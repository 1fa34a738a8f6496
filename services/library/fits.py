"""Fits of models to runs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError, nearest
from lacet.daq.formats.open_run import open_log
from lacet.identify.effects import catalogue as effects
from lacet.identify.effects.base import Effect
from lacet.identify.progress import silent
from lacet.identify.regression import wls
from lacet.identify.regression.model import Model
from lacet.identify.selection.candidate import Candidate
from lacet.identify.selection.joint.shape_constants import constants_by_runs
from lacet.identify.validation.noise_floor import SCORE_DRAWS, NoiseFloor, floor_of
from lacet.identify.validation.parameter_estimates import Estimate, estimates
from lacet.identify.validation.prediction_uncertainty import Knowledge
from lacet.identify.validation.score import compare
from lacet.identify.wheel_loads.known_car import Changes
from lacet.identify.wheel_loads.lack_of_fit import known_car
from lacet.identify.wheel_loads.observer import estimate_forces
from lacet.identify.wheel_loads.outputs import EstimatedForces
from lacet.services.library.display import html_table, shortened
from lacet.services.library.pictures import Picture, drawn
from lacet.services.library.runs import LoadingWarning, Runs
from lacet.services.one_thread import one_thread
from lacet.services.render import tables
from lacet.services.render.intervals import half_width, to_interval, with_interval
from lacet.services.render.progress import in_words
from lacet.services.workspace.loading import checked_run
from lacet.services.workspace.results import fit_result


@dataclass(frozen=True, repr=False)
class Fit:
    """A model fitted to runs by weighted least squares.

    Returned by `lacet.fit` and `lacet.add`.

    Attributes
    ----------
    model : the sum of effects that was fitted.
    runs : the runs used.
    details : covariance matrices, residuals, sensor offsets, the equations.

    Examples
    --------
    >>> 40e3 < fitted.value("spring.fl.k") < 55e3
    True
    >>> print(fitted.summary().splitlines()[0])
    reference-car, 2 runs, hub wheel loads
    """

    model: Model
    runs: Runs
    details: wls.Fit = field(repr=False)

    @cached_property
    def parameters(self) -> tuple[Estimate, ...]:
        """Estimates of all parameters of the model: value, unit, half of the 95 % interval, identifiability."""
        return tuple(estimates(self.details, runs=self.details.runs))

    def value(self, name: str) -> float:
        """Value of a parameter by name [SI]. Raises KeyError with the nearest match."""
        return self._named(name).value

    def interval(self, name: str) -> tuple[float, float]:
        """95 % interval of a parameter [SI], the sensor sheet's tolerances included. Raises KeyError as `value`."""
        one = self._named(name)
        return one.value - one.half_sheet, one.value + one.half_sheet

    def _named(self, name: str) -> Estimate:
        for one in self.parameters:
            if one.name == name:
                return one
        raise KeyError(f"there is no parameter '{name}'{nearest(name, [p.name for p in self.parameters])}")

    def plot(self, names: Iterable[str] | None = None, known: Mapping[str, float] | None = None) -> Picture:
        """Draw parameters with their 95 % intervals, relative to their values (a forest plot).

        Parameters
        ----------
        names : those drawn; by default all that are identifiable and not zero.
        known : values known otherwise by name [SI], drawn as crosses.

        Raises KeyError for an unknown name as `value`, UsageError for one that is not identifiable.
        """
        chosen = [self._named(name) for name in names] if names is not None else [
            one for one in self.parameters if one.identifiable and one.value
        ]  # fmt: skip
        if vague := [one.name for one in chosen if not one.identifiable]:
            raise UsageError(f"not identifiable with these runs, so there is no interval to draw: {', '.join(vague)}")

        def draw() -> bytes:
            from lacet.services.render.figures.png import png
            from lacet.services.render.figures.result_plots import forest_figure

            return png(forest_figure(chosen, known or {}))

        return drawn(f"95 % intervals of {len(chosen)} parameters", draw)

    @cached_property
    def knowledge(self) -> Knowledge:
        """Joint uncertainty of the parameters, for predictions of other runs."""
        return Knowledge.of(self.details)

    @cached_property
    def _floors(self) -> dict[int, NoiseFloor]:
        """Noise floors simulated so far, by number of draws."""
        return {}

    def noise_floor(self, draws: int) -> NoiseFloor:
        """The residual that the sensors' noise alone would leave, simulated `draws` times and stored."""
        if draws not in self._floors:
            with one_thread():
                self._floors[draws] = floor_of(self.details, draws)
        return self._floors[draws]

    @cached_property
    def _result(self) -> dict[str, Any]:
        return fit_result(self.details, self.runs.loaded, (), knowledge=self.knowledge)

    def forces(
        self,
        run: str | Path,
        *,
        held: Runs | None = None,
        mass: tuple[float, float] = (0.0, 0.0),
        rest: tuple[float, float] | None = None,
    ) -> EstimatedForces:
        """Wheel forces of a run without dynamometers, with 95 % bands (docs/forces.md).

        A doubtful channel of the run is a `LoadingWarning`, as in `load_runs`.

        Parameters
        ----------
        run : file of a run of the same car, by the instruments of the runs used; its own wheel loads are not used.
        held : runs held out, from which the lack of fit is taken; by default the runs used.
        mass : change of each wheel's mass since those runs, and its 1 σ [kg].
        rest : interval [s] in which the car stands: static offsets are then taken anew.

        Returns
        -------
        EstimatedForces
            By name: ``fitted.forces("run.parquet")["wheel.fl.force_estimated.z"].value``, ``.half95``.

        Raises
        ------
        LacetError
            The file is wrong, or a channel is lacking without which the forces cannot be found; it is named.
        """
        loaded = self.runs.loaded
        with one_thread():
            recording = self.runs.prepared[0].recording
            read = replace(open_log(Path(run), None), wheel_reference=loaded.reference)
            checked = checked_run(read, loaded.vehicle, loaded.rig, recording.filters)
            for doubt in checked.doubts:
                warnings.warn(f"{checked.run.name}: {doubt}", LoadingWarning, stacklevel=2)
            compared = [(one, compare(self.details, one, SCORE_DRAWS)) for one in held or self.runs]
            car = known_car(self.details, self.knowledge, compared)
            return estimate_forces(car, checked.prepared, Changes(*mass, rest))

    def summary(self) -> str:
        """Parameters with their intervals, whole-vehicle and derived values, and those not identifiable, as text."""
        result = self._result
        many = "s" if len(self.runs) > 1 else ""
        lines = [f"{self.runs.vehicle.name}, {len(self.runs)} run{many}, {self.runs.reference} wheel loads", ""]
        lines += [tables.parameters(result), "", tables.derived(result)]
        if unknown := [one.name for one in self.parameters if not one.identifiable]:
            lines += ["", f"Not identifiable with these runs: {', '.join(unknown)}"]
        return "\n".join(lines)

    def __repr__(self) -> str:
        known = [one for one in self.parameters if one.identifiable]
        added = [effect.key for effect in self.model.effects if not effect.base]
        head = (
            f"Fit of the base model{''.join(f' + {key}' for key in added)} to {', '.join(self.runs.names)}: "
            f"{len(known)} of {len(self.parameters)} parameters identified"
        )
        lines = [f"  {one.name} = {with_interval(one.value, one.half)} {one.unit}" for one in known]
        return shortened("\n".join([head, *lines]))

    def _repr_html_(self) -> str:
        rows = [
            [one.name, to_interval(one.value, one.half), half_width(one.half_sheet), half_width(one.half), one.unit]
            for one in self.parameters
            if one.identifiable
        ]
        head = ["parameter", "value", "± with sheet", "± noise only", "unit"]
        return html_table(f"Fit to {', '.join(self.runs.names)}", head, rows)


def catalogue(runs: Runs) -> dict[str, Effect]:
    """Every effect and sensor fault that can act on the car of these runs, by key (``family.place``).

    Parameters
    ----------
    runs : runs of the car.

    Examples
    --------
    >>> lacet.catalogue(runs)["anti_roll_bar.front"].about
    'anti-roll bar: couples left and right travel of an axle'
    """
    return effects.catalogue(runs.vehicle, runs.reference, runs=runs.names)


def base_model(runs: Runs) -> Model:
    """The base model of the car of these runs: rigid bodies, springs, dampers, static loads, tyre stiffness.

    Parameters
    ----------
    runs : runs of the car.

    Returns
    -------
    Model
        A sum of effects; ``model + effect`` is the model with one more.

    Examples
    --------
    >>> "spring.fl" in lacet.base_model(runs)
    True
    """
    return Model.of(effects.base_model(runs.vehicle, runs.reference))


def fit(model: Model, runs: Runs, *, robust: bool = False, progress: Callable[[str], object] | None = None) -> Fit:
    """Fit a model to runs by weighted least squares, with correction of the bias from noise in the regressors.

    Parameters
    ----------
    model : the model to fit.
    runs : the runs used.
    robust : give seconds with unusually large residuals less weight (Huber).
    progress : called with a sentence at each step, e.g. ``print``.

    Returns
    -------
    Fit
        Parameters with 95 % intervals that allow for residuals correlated in time and across rows.

    Raises
    ------
    NotIdentifiable
        No row of the equations is measured, or no parameter acts on one that is.

    Examples
    --------
    >>> lacet.fit(lacet.base_model(runs), runs).runs.names
    ('sine', 'liftoff')
    """
    return _fitted(model, runs, wls.FitOptions(robust=robust), progress)


def _fitted(model: Model, runs: Runs, options: wls.FitOptions, progress: Callable[[str], object] | None) -> Fit:
    # One thread, as on the command line: the same digits, in half the processor time and less time altogether.
    with one_thread():
        details = wls.fit(model, runs.prepared, options, progress=in_words(progress) if progress else silent)
    return Fit(model, runs, details)


def add(
    fitted: Fit,
    effect: str | Effect | Candidate | Iterable[str | Candidate] | None,
    *,
    progress: Callable[[str], object] | None = None,
) -> Fit:
    """Fit a model with one more effect, or several, to the same runs with the same options.

    Parameters
    ----------
    fitted : the fit of the present model.
    effect : an effect of the catalogue by its key, a candidate of a ranking, several of these (``ranking.missing``), or
        a user's own effect. A candidate brings its shape constants, and the effects of which only the sum is known; the
        constants of a key are searched on the runs, so that the effects explain most together.
    progress : as for `fit`.

    Raises
    ------
    UsageError
        There is no such effect, it is in the model already, or the ranking proposed none (`effect` is None).

    Examples
    --------
    >>> both = lacet.add(fitted, "anti_roll_bar.front")
    >>> "anti_roll_bar.front" in both.model
    True
    """
    wanted = list[str | Effect | Candidate]()
    if isinstance(effect, Iterable) and not isinstance(effect, str):
        wanted += effect
    elif effect is not None:
        wanted.append(effect)
    if not wanted:
        raise UsageError("there is no effect to add: the ranking proposes none (its explain() says why)")
    model, free = fitted.model, list[Effect]()
    for one in wanted:
        for added in _found(fitted.runs, one):
            if added.key in model and added.key not in fitted.model:
                continue  # an earlier candidate brought it
            model += added
            if isinstance(one, str) and added.grids:
                free.append(added)
    if free:
        floor, steps = fitted.noise_floor(SCORE_DRAWS), in_words(progress) if progress else silent
        with one_thread():
            found = {one.key: one for one in constants_by_runs(fitted.details, floor, free, steps)}
        model = Model.of(found.get(one.key, one) for one in model.effects)
    return _fitted(model, fitted.runs, fitted.details.options, progress)


def _found(runs: Runs, effect: str | Effect | Candidate) -> list[Effect]:
    """The effects that one argument of `add` stands for."""
    if isinstance(effect, str):
        return [effects.find_effect(effect, catalogue(runs))]
    if isinstance(effect, Candidate):
        keys = effect.total.keys if effect.total else (effect.key,)
        found = [effects.find_effect(key, catalogue(runs)) for key in keys]
        return [replace(one, shape={**one.shape, **effect.shape}) for one in found]
    return [effect]
