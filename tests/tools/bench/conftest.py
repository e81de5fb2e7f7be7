"""A small database and its held-out take, for all tests below."""

from small_database import *  # noqa: F403
