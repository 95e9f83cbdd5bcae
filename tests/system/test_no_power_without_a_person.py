"""After a fault nothing powers, homes or moves until a person asks for it again: pedals and standing wishes don't."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.slow
