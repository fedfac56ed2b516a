"""What is said of start values that the observations contradict."""

import numpy as np
import pytest

from mor.start.join import Contradiction


@pytest.mark.parametrize(("angle", "said"), [(0.03, "30 mrad"), (np.pi / 3.0, "67 gon"), (np.pi, "200 gon")], ids=str)
def test_small_angles_are_said_in_mrad_and_large_ones_in_gon(angle, said):
    one = Contradiction(0, "image 1", 2.0 * np.sin(0.5 * angle))
    assert str(one) == f"image 1: the observations contradict it by {said}"
