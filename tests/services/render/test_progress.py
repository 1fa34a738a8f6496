"""The sentence of each step that a long computation reports."""

import pytest

from lacet.identify.progress import Stage, Step
from lacet.services.progress import TRIAL, ServiceStage, ServiceStep
from lacet.services.render.progress import in_words, sentence


@pytest.mark.parametrize("stage", [*Stage, *ServiceStage])
def test_every_stage_has_a_sentence(stage):
    """None is forgotten, and none ends in a full stop: numbers may follow."""
    text = sentence(ServiceStep(stage, 1, 2, subject="sine"))
    assert text
    assert not text.endswith(".")


@pytest.mark.parametrize(
    ("step", "text"),
    [
        (ServiceStep(ServiceStage.READING_RUNS, total=3, subject="held out"), "reading 3 runs held out"),
        (ServiceStep(ServiceStage.READING_RUNS, campaign="simulation"), "simulation: reading the runs"),
        (ServiceStep(ServiceStage.READING_RUN, 1, 3, "used"), "reading runs used: 1 of 3"),
        (ServiceStep(ServiceStage.READING_RUN, 0, 2), "reading runs: 0 of 2"),
        (ServiceStep(ServiceStage.FITTING), "fitting"),
        (Step(Stage.NOISE_CORRECTION, 1, 4), "fitting: 1 of 4 runs"),
        (ServiceStep(ServiceStage.FITTING, version=1), "fitting version 1 (the base model alone)"),
        (
            ServiceStep(ServiceStage.FITTING, effects=("coulomb.front", "payload"), version=2),
            "fitting version 2 (coulomb.front, payload)",
        ),
        (
            ServiceStep(ServiceStage.FITTING, effects=("coulomb.front", "payload"), version=TRIAL),
            "fitting the model with payload added",
        ),
        (
            ServiceStep(ServiceStage.FITTING, values={"speed": 0.05}, campaign="experiment"),
            "experiment: fitting with speed = 0.05",
        ),
        (ServiceStep(Stage.NOISE_CORRECTION, 1, 4, version=2), "fitting version 2: 1 of 4 runs"),
        (
            ServiceStep.of_version(Step(Stage.NOISE_CORRECTION, 1, 4), TRIAL, ["payload"]),
            "fitting the model with payload added: 1 of 4 runs",
        ),
        (ServiceStep(ServiceStage.COMPARING, version=2), "comparing the runs with version 2"),
        (ServiceStep(ServiceStage.COMPARING, 0, 2, "sine"), "comparing sine with the model"),
        (
            ServiceStep.of_version(Step(ServiceStage.COMPARING, 0, 2, "sine"), TRIAL, ["payload"]),
            "comparing sine with the model with payload added",
        ),
        (Step(Stage.NOISE_FLOOR), "simulating the noise floor"),
        (Step(Stage.NOISE_FLOOR, 7, 199), "simulating the noise floor: 7 of 199"),
        (
            Step(Stage.LATENCIES, values={"imu": 0.0012, "fl": -0.02}),
            "reading the runs with imu +1.2 ms, fl -20.0 ms",
        ),
        (
            Step(Stage.RELINEARISATION, 2, values={"a": 0.001, "b": -0.0042}),
            "the runs read again, latencies up to 4.2 ms removed (2)",
        ),
        (Step(Stage.REGRESSOR_NOISE, 7, 80), "the noise in what they follow: 7 of 80 draws"),
        (ServiceStep(ServiceStage.SIMULATING_RUN, 2, 9, "sine at 20 m/s"), "simulating 2 of 9: sine at 20 m/s"),
        (ServiceStep(ServiceStage.WRITING_LOG, 40, 100), "writing, 40 of 100 %"),
        (ServiceStep(ServiceStage.DRIVING, 37, 100, "sine", campaign="simulation"), "simulation: driving sine, 37 %"),
    ],
)
def test_what_a_step_says(step, text):
    """With its own numbers and names."""
    assert sentence(step) == text


def test_what_is_called_may_stop_the_computation():
    """An error of the listener passes through, as a cancelled job needs."""

    def full(text: str) -> None:
        raise KeyboardInterrupt(text)

    with pytest.raises(KeyboardInterrupt, match="ranking"):
        in_words(full)(ServiceStep(ServiceStage.RANKING_RUNS))
