"""Thresholds, limits and counts of the selection, each with meaning, unit and source.

Bars whose source is *benchmark* were set on the development trials of the blind benchmark (docs/benchmarks/blind.md),
each for trials that docs/decisions/ranking.md or docs/decisions/clocks.md describe: they are no constants of nature.
Those that are *numerical* only separate rounding from numbers; results do not depend on them.
"""

from __future__ import annotations

from dataclasses import dataclass

from lacet.identify.intervals import TWO_SIDED_95
from lacet.identify.regression.uncertainty import BLOCK


@dataclass(frozen=True)
class SelectionSettings:
    """Bars, limits and counts of the search for a missing effect.

    A share is a dimensionless part of a sum of weighted squares unless another whole is named.
    """

    # -- what may be proposed ------------------------------------------------------------------------------------------

    significance: float = 0.01
    """Family-wise error of a proposal [probability]: the max-score statistic against simulated runs. Source: method
    section 6, step 7."""
    law_inexactness: float = 0.05
    """RMS force by which a catalogue's law in the model may differ from the true one, ÷ that of the law [share]. A
    further effect must explain more than its square. Source: docs/decisions/joint-search.md."""
    selected_inexactness: float = 0.2
    """The same for a law that is selected and not yet in the fit (its noise is that of other constants, and the floor
    is one without it), for the same law at another place (left and right are never equal), and for a law that only
    describes a force of unknown cause [share]. Source: docs/decisions/joint-search.md."""
    most_selected: int = 12
    """Effects selected together before a fit with them [count]. Source: processor time."""
    most_free_steps: int = 2
    """Candidates that are fitted, of those that explain more where a law found has other shape constants, and of those
    in the place of two [count]. Source: processor time."""
    exchanged_share: float = 0.5
    """Part of the weighted squares of a law, or of two, that it may still explain beside a candidate which takes its
    place [share]. Source: the smaller part."""
    most_refits: int = 4
    """Fits with all effects found so far, each with a new noise floor and search, and steps that improve the effects of
    one of them [count]. Source: processor time."""
    most_starts: int = 3
    """Searches in all, where with what is found the sheet would have to be wrong, or beside a weak scale something
    unlisted remains, each of the others beginning with another significant effect [count]. Source: processor time."""
    least_gain: float = 0.01
    """Part of the weighted residual of the rows a candidate acts on, or of one of them, that it must take away [share].
    Source: method section 6, step 7; docs/decisions/ranking.md, "A gain of 1 %"."""
    effect_size: float = 0.01
    """The user's effect size: RMS force of a rest ÷ RMS variation of the force in its row [share]. What is less is
    reported as small, and is no unlisted cause. Source: a choice of the user; docs/ranking.md."""
    least_coverage: float = 3.0
    """Effective number of blocks (Σe)²/Σe² in which a candidate must act [blocks]. Source: method section 6, step 3."""
    least_size: float = 8.0
    """Weighted size √λ that the largest plausible effect must have beside all nuisance parameters [noise σ]. Source:
    method section 6, step 3."""
    most_noise_in_candidate: float = 0.5
    """Part of a candidate's reduced columns that may be noise, and be noise of its own columns; beyond it the runs do
    not show what it would do [share]. Source: benchmark; docs/ranking.md, step 3."""
    most_noise_in_fault: float = 0.2
    """Part of a sensor fault's column that may be noise for it to be tested without its own tolerance [share]; with
    more noise it is tested within its tolerance. Source: benchmark; docs/decisions/ranking.md, "A fault's column holds
    noise"."""
    correction_doubt: float = 0.1
    """Part of the noise correction of a fault's score by which the correction itself may be wrong, not counted as the
    fault's effect [share]. Source: benchmark; docs/decisions/ranking.md, "A fault's column holds noise"."""
    interval_quantile: float = TWO_SIDED_95
    """Half of a 95 % interval [σ]. Source: the normal distribution."""

    # -- which rows fail, and by what ----------------------------------------------------------------------------------

    failing_ratio: float = 1.05
    """Residual ÷ noise floor above which a row can fail [ratio]. Source: benchmark."""
    failing_chance: float = 0.05
    """Part of simulated runs that may have any row as far above its floor, for a row to fail [probability]. Source: the
    usual 5 %, family-wise over rows."""
    most_noise_ratio: float = 3.0
    """No sensor is more times as noisy as its sheet says; what is above that is a cause [ratio]. Source: benchmark;
    docs/decisions/ranking.md, "Louder sensors"."""
    quiet_bands: float = 0.25
    """Part of a residual's frequency bands, the quietest, that gives the level of the noise [quantile]. Source:
    docs/decisions/ranking.md, "Unlisted"."""
    coloured_share: float = 0.5
    """Part of an excess that must stand above the level of the noise, in frequency, to be no noise [share]. Source:
    docs/decisions/ranking.md, "Unlisted" ("most of it")."""

    # -- when the cause is called unlisted -----------------------------------------------------------------------------

    tolerance_squares_ratio: float = 2.0
    """The tolerance test fails from this many times the mean of the squared tolerances in simulated runs [ratio].
    Source: benchmark; docs/decisions/ranking.md, "A sheet that would have to be wrong"."""
    worst_rows_share: float = 0.5
    """Where no row fails beside the tolerances: rows for which laws are sought have this part of the squares above the
    floor that the worst row has [share]. Source: a choice, not tuned."""

    most_laws: int = 3
    """Simple laws described for an unlisted cause [count]. Source: a choice of presentation."""

    # -- parameter constancy across runs (Chow test) -------------------------------------------------------------------

    least_energy_of_run: float = 1e-3
    """Part of a law's energy that a run must hold to be compared [share]. Source: a choice, not tuned."""
    inconstant_share: float = 0.15
    """A law is inconstant when its differences between runs explain this part of what it explains itself, or, where
    that is more, of what differences as large as the law would (parameters that scatter by two fifths) [share]. Source:
    benchmark; docs/decisions/ranking.md, "A law holds in every run"."""
    chow_seconds: float = 64.0
    """Data beyond this, of the runs that show least, are taken as one run [s]: noise is drawn for each of the others.
    Source: processor time; docs/decisions/ranking.md, "A law holds in every run"."""
    chow_noise_pairs: int = 1
    """Antithetic pairs of draws of the noise in each run's columns [count]. Source: processor time."""

    # -- shape constants and rivals ------------------------------------------------------------------------------------

    same_correlation: float = 0.98
    """Canonical correlation from which two laws are one on these runs (a rebound stop, a helper spring in tension)
    [correlation]. Source: a choice; benchmark."""
    rival_share: float = 0.5
    """Part of an effect's fall of the weighted squares from which a candidate, on its grid, may be its rival [share].
    Source: processor time."""
    most_rivals: int = 6
    """Rivals compared with an effect [count]. Source: processor time."""
    most_constant_rounds: int = 12
    """Rounds of the search for shape constants, a pass over the samples each [count]. Source: processor time."""
    least_ratio_of_bounds: float = 4.0
    """Upper ÷ lower bound of a constant from which it is searched in ratios [ratio]. Source: a choice, not tuned."""
    least_constant_step: float = 0.05
    """Distance of two values in that search, ÷ that of the effect's grid, below which it ends [share]. Source: a
    choice, not tuned."""
    least_refinement_fall: float = 4.0
    """Fall of the weighted squares by which a value off the grid must be better at first, and a rival for it to take a
    law's place; so much more each constant must explain that is not common to the places of a law, or not the simplest;
    so much a search of constants may leave, and a rival with fewer of them explain less [weighted squares].
    Source: two σ of one parameter (χ² with one degree of freedom, 95 %: 3.84)."""

    table_error: float = 0.25
    """Largest error of a bench table that is thought of as part of a law found, ÷ what it says [share]. Source: a
    choice; docs/bench.md."""
    confounded_share: float = 0.1
    """Part of a law's size by which such a table must change it to be named beside it [share]. Source: a choice."""
    confounded_interval: float = 0.5
    """The same ÷ half of the 95 % interval of the size, with the sensor sheet: what widens that by an eighth [share].
    Source: a choice."""

    # -- re-linearisation at late instruments --------------------------------------------------------------------------

    first_order_phase: float = 0.15
    """ω τ at the fit's cut-off up to which a latency's first-order column is right [rad]. Source:
    docs/decisions/clocks.md, "A rate is a latency only as long as ω τ is small"."""
    settled_phase: float = 0.02
    """ω τ below which re-linearisation stops [rad]. Source: benchmark."""
    most_phase_of_step: float = 1.0
    """ω τ of the longest step of a re-linearisation [rad]: beyond, the sine bends back. Source: numerical."""
    most_relinearisations: int = 5
    """Steps of a re-linearisation [count]. Source: docs/decisions/clocks.md."""
    second_order_share: float = 0.25
    """Part of what a candidate takes away that the second order of latencies may be, before its screening is repeated
    [share]. Source: docs/decisions/clocks.md."""

    # -- cross-validation and noise in the columns ---------------------------------------------------------------------

    folds: int = 5
    """Folds of the blocked cross-validation [count]. Source: T. Hastie, R. Tibshirani and J. Friedman, The Elements of
    Statistical Learning (2009), 7.10."""
    block_seconds: float = BLOCK
    """Length of a block of it [s]. Source: method section 6, step 3: longer than the residual's memory."""
    noise_pairs: int = 2
    """Antithetic pairs of draws of the noise in all columns [count]. Source: processor time;
    docs/decisions/ranking.md, "Noise in the columns"."""
    noise_seconds: float = 180.0
    """Of more data than this, one pair is drawn [s]: the error of the draws' mean falls with the root of the data's
    length. Source: processor time."""
    most_noise_of_direction: float = 0.8
    """No more of a direction of the nuisance columns is counted as noise: it is drawn, not known [share]. Source:
    benchmark; docs/decisions/ranking.md, "Noise in the columns"."""

    # -- what a user reads ---------------------------------------------------------------------------------------------

    reported_tolerances: float = 3.0
    """Entries of the sensor sheet beyond this are reported to the user [tolerances]. Source: three σ."""
    reported_noise_ratio: float = 1.3
    """Noise ÷ sheet above which a row is reported to the user as noisier [ratio]. Source: a choice of presentation."""
    reported_row_ratio: float = 1.3
    """Residual ÷ floor of a row from which the user reads what of it the sensors' tolerances explain [ratio]. Source: a
    choice of presentation."""
    most_reported: int = 4
    """Candidates, rows or entries listed in one sentence [count]. Source: a choice of presentation."""
    most_absorbing: int = 3
    """Parameters listed as absorbing an effect that cannot be tested [count]. Source: a choice of presentation."""
    absorbed_share: float = 0.05
    """Part of a column's energy from which a parameter is listed as absorbing it [share]. Source: a choice of
    presentation."""

    # -- rounding ------------------------------------------------------------------------------------------------------

    gone_share: float = 1e-10
    """Part of a column's energy below which nothing of it remains [share]. Source: numerical."""
    shared_eigenvalue: float = 1e-9
    """Part of the largest eigenvalue below which a direction is one that other columns have too [share]. Source:
    numerical."""
    tolerance_rank: float = 1e-9
    """Relative singular value below which tolerances that stand for a fault are one [share]. Source: numerical."""
    tolerance_part: float = 1e-3
    """Part of a fault's column, as amplitude, from which a tolerance stands for it [share]. Source: numerical."""
    correlation_ridge: float = 1e-12
    """Added to each diagonal before columns are correlated: of a law's parameters one may all but double another
    [share]. Source: numerical."""
    smallest_p_slack: float = 1e-12
    """Rounding allowed when a p is compared with the smallest there can be [probability]. Source: numerical."""

    def level(self, draws: int) -> float:
        """Probability up to which a result is significant: `significance`, or the least that `draws` runs can show."""
        return max(self.significance, 1.0 / (1.0 + draws)) + self.smallest_p_slack


SELECTION = SelectionSettings()
"""The settings in use."""
