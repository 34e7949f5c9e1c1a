"""Recordings of evacuations: written as they run, in the formats of JuPedSim, PedPy and data frames, and read back."""

from crowd_env.recording.content import FrameContacts
from crowd_env.recording.formats import FORMATS
from crowd_env.recording.recorder import RunRecorder, record
from crowd_env.recording.recording import Recording, load
from crowd_env.recording.storey import of_storey

__all__ = ["FORMATS", "FrameContacts", "Recording", "RunRecorder", "load", "of_storey", "record"]
