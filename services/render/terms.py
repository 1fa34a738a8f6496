"""Terms of the page, each in a sentence, with the page of the documentation that says more."""

from __future__ import annotations

from typing import NamedTuple

from lacet.identify.design.discrimination import NEEDED
from lacet.identify.regression.uncertainty import BLOCK
from lacet.identify.selection.settings import SELECTION
from lacet.identify.validation.score import FAILS


class Term(NamedTuple):
    """A term as shown, what it means in a sentence, and its page in ``docs``."""

    name: str
    says: str
    page: str


TERMS: dict[str, Term] = {
    "row": Term(
        "row",
        "One scalar equation of motion: a wheel's suspension, tyre or spin, or a force or moment on the chassis. "
        "What the model predicts in it is compared with what was measured.",
        "rows.md",
    ),
    "floor": Term(
        "noise floor",
        "RMS that the sensors' noise alone would leave in a row after the same fit; it is simulated from the rig file.",
        "glossary.md",
    ),
    "error": Term(
        "error ÷ floor",
        "RMS of measured − modelled over the samples of all runs used, divided by the RMS of the noise floor over"
        f" the same samples. 1 is the floor; a row fails above {FAILS:g}.",
        "glossary.md",
    ),
    "worst": Term(
        "worst run",
        "The largest error ÷ floor that a row has in any single run, used or held out.",
        "rows.md",
    ),
    "held": Term(
        "held out",
        "A run that the fit has never seen. An error that falls there too is a real one.",
        "glossary.md",
    ),
    "vaf": Term(
        "variance explained",
        "100 % less the residual's part of the measured variance. A dash stands where a row is hardly more than noise.",
        "glossary.md",
    ),
    "validation": Term(
        "direct and cross validation",
        "Direct: the run was used for the fit. Cross: it was held out, and is predicted by a model fitted to other "
        "runs.",
        "glossary.md",
    ),
    "span": Term(
        "error ÷ span",
        "RMS of measured − modelled in per cent of the largest less the smallest measured value of the run.",
        "glossary.md",
    ),
    "colour": Term(
        "residual like noise, or coloured",
        "Whether the residual's spectrum is that of the sensors' noise; otherwise the frequency of the largest excess.",
        "derived.md",
    ),
    "judged": Term(
        "verdict",
        f"A row fails above {FAILS:g} times its floor. A run held out is not judged where the fit knows too little of "
        "what it needs.",
        "derived.md",
    ),
    "source": Term(
        "source of a row",
        "Whether the channels of a row's equation are measured, derived from others or assumed with a tolerance; else "
        "what would have to be added.",
        "fewer-instruments.md",
    ),
    "share": Term(
        "share of an effect",
        "Part of the modelled row that one effect makes. All shares and the zeros of the sensors add up to it.",
        "glossary.md",
    ),
    "effect": Term(
        "effect",
        "One term of the model: a physical law or a fault of a sensor, linear in its parameters, at one place of "
        "the car.",
        "catalogue.md",
    ),
    "enough": Term(
        "enough",
        "Half of a parameter's 95 % interval with the sheet is at most the target, in per cent of its value. The time "
        "still needed is that of driving on as until now; gains, latencies and zeros of the sensors set a limit to it.",
        "live.md",
    ),
    "interval": Term(
        "95 % interval",
        "The true value lies in it 95 times in 100. With the sheet it also holds the tolerances of the sensors' "
        "gains and latencies.",
        "intervals.md",
    ),
    "gain": Term(
        "gain",
        "What adding the effect takes off its rows' residual, in parts of the runs it was not fitted to.",
        "ranking.md",
    ),
    "p": Term(
        "p",
        "Probability that runs which lack nothing show as large a fall by chance in any candidate; from simulated"
        " runs.",
        "ranking.md",
    ),
    "blocks": Term(
        "blocks",
        f"Number of stretches of {BLOCK:g} s in which the effect acts. Fewer than {SELECTION.least_coverage:g} are too "
        "few to test it.",
        "ranking.md",
    ),
    "answer": Term(
        "answer",
        "Whether the model lacks the effect: missing, undecided, a stand-in for another, too small, not needed, "
        "or not testable on these runs.",
        "ranking.md",
    ),
    "lead": Term(
        "weighted squares ahead",
        "By how much the effect explains the residual better than its best rival, in squares of the noise floor. "
        f"At {NEEDED:g} the wrong one is picked once in 160 times.",
        "separation.md",
    ),
    "signature": Term(
        "signature",
        "The form in which an effect shows in the residual of a model that lacks it, over the state it follows.",
        "catalogue.md",
    ),
    "map": Term(
        "residual map",
        "Error ÷ floor of every row in half a second each, over the runs.",
        "where.md",
    ),
    "phase": Term(
        "phase of driving",
        "A stretch of a run by what the car does: standing, braking, cornering, rough road.",
        "where.md",
    ),
    "coherence": Term(
        "coherence",
        "Part of the residual's power, frequency by frequency, that is linear in a state, however delayed.",
        "where.md",
    ),
    "left": Term(
        "left to explain",
        "Part of a residual that smooth functions of the measured states predict, in stretches that the "
        "prediction was not made from.",
        "where.md",
    ),
    "surface": Term(
        "restoring force",
        "Mean force, or mean error, of a suspension over its travel and travel rate: the form of a missing law "
        "shows in it.",
        "where.md",
    ),
    "own": Term(
        "effect of your own",
        "A law in one line, a free name for each parameter. It is read and its units are checked; it is never run"
        " as a program.",
        "effects.md",
    ),
    "next": Term(
        "next run",
        "The manoeuvre, of a library that is simulated, after which tied effects come apart or an effect that "
        "these runs cannot test would show.",
        "separation.md",
    ),
    "sensor_state": Term(
        "state of a sensor",
        "Running, or what the recorder sees to be wrong: silent, slow, babbling (too many samples), stuck (its value "
        "stands still while the car moves), or clock (its time jumps).",
        "live.md",
    ),
    "flagged": Term(
        "flagged samples",
        "Samples marked as unusable: beyond the range, reported bad by the sensor, or stuck.",
        "log.md",
    ),
    "losses": Term(
        "losses of a channel",
        "Blocks of samples that did not reach this page. The recorder's log has its own count.",
        "live.md",
    ),
    "marker": Term(
        "marker",
        "A time in the recording with a text, kept in the log; commands take it as the beginning or the end of a run.",
        "live.md",
    ),
    "apriori": Term(
        "a priori",
        "The value in the vehicle file, before any run was driven.",
        "vehicle.md",
    ),
    "ride_rate": Term(
        "ride rate",
        "Stiffness of a corner between body and road: its spring in series with the tyre, at the wheel, bars apart.",
        "derived.md",
    ),
    "damping_ratio": Term(
        "damping ratio of the body",
        "Damping of the body's motion on one corner ÷ critical damping.",
        "derived.md",
    ),
    "static_load": Term(
        "wheel load at rest",
        "Load under the tyre of the car standing on a flat road.",
        "derived.md",
    ),
    "ride_frequency": Term(
        "natural frequency of the body",
        "Undamped frequency of the body on an axle's springs, dampers and tyres.",
        "derived.md",
    ),
    "hop_frequency": Term(
        "natural frequency of the wheel",
        "Undamped frequency of an axle's wheels between springs and tyres.",
        "derived.md",
    ),
    "roll_stiffness": Term(
        "roll stiffness",
        "Roll moment of an axle's springs and anti-roll bar, per degree of body roll against the axle.",
        "derived.md",
    ),
    "roll_gradient": Term(
        "body roll per g",
        "Roll of the body against the road for each g of lateral acceleration, tyres included.",
        "derived.md",
    ),
    "load_transfer": Term(
        "load transfer per g",
        "Load that moves from the inner to the outer wheel of an axle for each g of lateral acceleration: through "
        "springs and bar, through the roll centre, and of the unsprung mass.",
        "derived.md",
    ),
    "version": Term(
        "version",
        "One model of the study with its fit and errors. It never changes; adding or removing an effect makes a "
        "new one.",
        "workbench.md",
    ),
}
"""Every term by its key."""
