"""Pictures of the first run: what they show is kept while it runs, and drawn when all runs are finished."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from crowd_env.cli.console import check_picture
from crowd_env.cli.films import check_film_options, film_file, said_of
from crowd_env.core.console import progress_bar
from crowd_env.envs.rollout import Episode, Recorder
from crowd_env.physics import ContactScheme
from crowd_env.scenarios.scenario import Scenario
from crowd_env.scenarios.titles import run_title

_LEAST_AROUND = 0.5  # m


@dataclass(frozen=True)
class FirstRun:
    """What is run."""

    place: Scenario
    scheme: ContactScheme
    options: Mapping[str, Any]  # of the environment, the scheme aside
    seed: int

    @property
    def title(self) -> str:
        """Return what stands above a picture."""
        return run_title(self.place, self.scheme.info.name)


class Output(Protocol):
    """Something that can be made of the first run; `crowd_env.cli.run` lists all of them."""

    @property
    def path(self) -> Path | None:
        """Where it is written; None = it is not asked for."""
        ...

    def check(self) -> None:
        """Raise ValueError or ModuleNotFoundError, before anything is read or run, if it cannot be made as it is asked for."""
        ...

    def recorder(self, run: FirstRun) -> Recorder:
        """Return what sees the run; raise ValueError, before anything is run, if it cannot be made of this one."""
        ...

    def write(self, run: FirstRun, episode: Episode) -> str:
        """Write it, and return a line that says where it is; the record of the episode is that of the own recorder."""
        ...


@dataclass(frozen=True)
class Film:
    """``--film``, with ``--film-width`` [px], ``--film-fps`` [1/s] and ``--film-speed``."""

    asked: Path | None
    width: int | None
    fps: float | None
    speed: float | None

    @cached_property
    def path(self) -> Path | None:
        """Where it is written: of what was asked for, a file."""
        return None if self.asked is None else film_file("--film", self.asked)

    def check(self) -> None:
        """Raise if an option is out of range or stands alone, the path cannot be written, or a library is missing."""
        options = {"--film-width": self.width, "--film-fps": self.fps, "--film-speed": self.speed}
        for option, value in options.items():
            if value is not None and self.path is None:
                raise ValueError(f"{option} belongs to --film, which is not given")
        check_film_options(self.width, self.fps, self.speed)

    def recorder(self, run: FirstRun) -> Recorder:
        """Return what keeps every decision."""
        from crowd_env.recording import RunRecorder

        return RunRecorder(seed=run.seed)

    def write(self, run: FirstRun, episode: Episode) -> str:
        """Draw the film."""
        from crowd_env.rendering import write_film

        assert self.path is not None  # else it is not asked for
        with progress_bar("film, frames") as progress:
            options: dict[str, Any] = {"width": self.width, "fps": self.fps, "speed": self.speed}
            write_film(self.path, episode.record, titles=[run.title], progress=progress, **options)
        return said_of(self.path)


@dataclass(frozen=True)
class ForceNetwork:
    """``--force-network``, with ``--at`` [s] and ``--around`` [m]."""

    path: Path | None
    at: float | None
    around: float | None

    def check(self) -> None:
        """Raise if an option is out of range or stands alone, the path cannot be written, or a library is missing."""
        for option, value, least in (("--at", self.at, 0.0), ("--around", self.around, _LEAST_AROUND)):
            if value is not None and self.path is None:
                raise ValueError(f"{option} belongs to --force-network, which is not given")
            if value is not None and not (value > 0 and value >= least):
                raise ValueError(f"{option} is {value:g}; it must be {f'>= {least:g} m' if least else '> 0'}")
        if self.path is not None:
            check_picture("--force-network", self.path, (".png",))

    def recorder(self, run: FirstRun) -> Recorder:
        """Return what keeps who presses on whom."""
        from crowd_env.recording import RunRecorder

        limit = run.place.time_limit
        if self.at is not None and self.at > limit:
            raise ValueError(f"--at is {self.at:g} s; the evacuation ends after {limit:g} s at the latest")
        return RunRecorder(contacts=True, seed=run.seed)

    def write(self, run: FirstRun, episode: Episode) -> str:
        """Draw the forces."""
        from crowd_env.rendering import forces_of, write_force_network

        assert self.path is not None  # else it is not asked for
        forces = forces_of(episode.record, self.at)
        write_force_network(self.path, forces, around=self.around, title=run.title)
        return f"forces: {self.path}, mean of 0.1 s until {forces.time:.1f} s"
