import pytest

from pincette.config import ConfigError, Simulation
from pincette.sim.instruments.fitting import resolved
from pincette.sim.plant.plant import plant_parameters

OPEN = {"output_step_V": None, "output_lag_s": None}


@pytest.mark.parametrize(
    ("driver", "step_V", "lag_s"),
    [
        ("icpdas_i7024", 0.001220703125, 0.0033),
        ("srs_dc205", 1e-6, 0.001),
        ("nidaqmx", 0.00030517578125, 3e-6),
    ],
)
def test_each_simulated_output_has_its_own_step_size_and_lag(
    simulation: Simulation, driver: str, step_V: float, lag_s: float
) -> None:
    known = resolved(simulation.model_copy(update=OPEN), driver)
    assert (known.output_step_V, known.output_lag_s) == (step_V, lag_s)
    assert plant_parameters(known).output_lag_s == lag_s


def test_numbers_of_the_rig_file_take_precedence(simulation: Simulation) -> None:
    given = simulation.model_copy(update={"output_step_V": 0.5, "output_lag_s": None})
    assert resolved(given, "srs_dc205").output_step_V == 0.5
    assert resolved(given, "srs_dc205").output_lag_s == 0.001
    whole = simulation.model_copy(update={"output_step_V": 0.5, "output_lag_s": 0.0})
    assert resolved(whole, "no such driver") is whole


def test_an_unknown_driver_is_named(simulation: Simulation) -> None:
    with pytest.raises(ConfigError, match=r"output\.driver = 'other': step and lag"):
        resolved(simulation.model_copy(update=OPEN), "other")


def test_the_simulated_arm_cannot_be_built_without_values_left_to_the_driver(
    simulation: Simulation,
) -> None:
    with pytest.raises(ValueError, match=r"output_step_V, output_lag_s: left to the driver"):
        plant_parameters(simulation.model_copy(update=OPEN))
