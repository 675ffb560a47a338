"""The small scan that all formats are written from."""

import pytest

from scan_samples import Sample, make_sample


@pytest.fixture(scope="session")
def sample() -> Sample:
    return make_sample()
