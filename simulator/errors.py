"""Errors that a user can act on: what was wrong, where, and what to do, in one line."""


class WaveformerError(Exception):
    """Base of every error the command line prints as one line without a traceback."""


class MeshError(WaveformerError):
    """A mesh cannot be simulated.

    Attributes:
        code: stable machine-readable reason, e.g. ``"mesh.empty"``.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


class RadarError(WaveformerError):
    """A chirp, aperture, grid or scene geometry makes no physical sense."""


class StoreError(WaveformerError):
    """A file cannot be read or written as asked."""


class SetupError(WaveformerError):
    """A library or system package that the work needs is missing or broken."""
