"""What every declared kind of reading and state of polarisation owes."""

from __future__ import annotations

import numpy as np
import pytest

import pbrdf_bayes as pb
from pbrdf_bayes.design.candidates import Candidate, Costs
from pbrdf_bayes.measurement import measurement_from_columns
from pbrdf_bayes.physics.geometry import polarization_codes
from pbrdf_bayes.quantities import (
    LIMITED,
    MEANT,
    PLANNED,
    POLARIZATIONS,
    QUANTITIES,
    READ,
    S_AND_P,
    STATES,
)
from pbrdf_bayes.specification import Limit


def test_states_of_polarisation_have_one_order_and_their_weights() -> None:
    assert POLARIZATIONS == ("s", "p", "u")
    assert S_AND_P == ("s", "p")
    assert [s.weights for s in STATES.values()] == [(1.0, 0.0), (0.0, 1.0), (0.5, 0.5)]
    assert list(polarization_codes(np.array(POLARIZATIONS))) == [0, 1, 2]


def test_a_word_of_others_means_one_thing() -> None:
    every = [w for entry in (*STATES.values(), *QUANTITIES.values()) for w in entry.synonyms]
    assert len(every) == len(set(every)) == len(MEANT)
    assert not set(MEANT) & {*STATES, *QUANTITIES}


@pytest.mark.parametrize("word", READ)
def test_what_a_file_holds_makes_a_measurement(word: str) -> None:
    theta_r_deg = [np.nan if QUANTITIES[word].hemispherical else 10.0]
    found = measurement_from_columns(
        sample="a", wavelength_um=1.0, quantity=[word], polarization=["s"], theta_i_deg=[20.0],
        theta_r_deg=theta_r_deg, value=[0.5],
    )  # fmt: skip
    assert len(found.dhr) == QUANTITIES[word].hemispherical
    assert found.n_obs == 1


@pytest.mark.parametrize("word", PLANNED)
def test_what_a_design_proposes_has_its_cost(word: str) -> None:
    what = QUANTITIES[word]
    scan = () if what.hemispherical else (0.0, 10.0)
    minutes = Costs().of(word, max(len(scan), 1))
    candidate = Candidate(
        word, "p", 20.0, minutes, theta_r_deg=scan, port_deg=5.0 if what.port else 0.0
    )
    assert candidate.minutes > 0.0
    with pytest.raises(pb.ConfigError):
        Candidate(word, "p", 20.0, minutes, theta_r_deg=() if scan else (0.0,))


@pytest.mark.parametrize("word", LIMITED)
def test_what_a_specification_limits_takes_its_angles(word: str) -> None:
    what = QUANTITIES[word]
    angles = dict.fromkeys(what.angles, (20.0,))
    polarization = "s" if what.polarized else ""
    limit = Limit(name="a", quantity=word, polarization=polarization, upper=0.5, **angles)
    assert limit.unit == what.shown_unit
    with pytest.raises(pb.ConfigError):
        Limit(name="a", quantity=word, polarization=polarization, upper=0.5)
