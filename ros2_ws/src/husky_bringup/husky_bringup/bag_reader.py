"""A bag that is read back: closed, cut short or damaged."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import yaml
from rosbags.highlevel import AnyReader, AnyReaderError

from husky_bringup.bag import INCOMPLETE_KEY
from husky_bringup.mcap_storage import check_index
from husky_bringup.salvage import SalvagedBag
from husky_runtime import graph

T = TypeVar("T")

_log = logging.getLogger(__name__)


class BagReader:
    """A bag; of one that was not closed, or is damaged, what is whole is read.

    Attributes:
        path: the bag.
        counts: messages by topic.
        start, end: first and last log time [s].
        damage: in one line, why this is not all that should have been recorded; "" when it is.
    """

    def __init__(self, path: Path | str):
        """Open a bag.

        Raises:
            FileNotFoundError: there is none.
            rosbags.highlevel.AnyReaderError: it cannot be read, and nothing in it is whole.
        """
        self.path = Path(path)
        self.damage = ""
        self._salvaged: SalvagedBag | None = None
        try:
            self._file = self._find_file()
            with AnyReader([self._file]) as reader:
                self.counts = {name: info.msgcount for name, info in reader.topics.items()}
                empty = reader.message_count == 0
                self.start = 0.0 if empty else reader.start_time / 1e9
                self.end = 0.0 if empty else (reader.end_time - 1) / 1e9  # it ends after the last
            self.damage = self._noted()
        except Exception as error:  # of damaged bytes: whatever the reader trips over
            self._salvage(error)

    def _find_file(self) -> Path:
        """Return what is to be read: the bag's one MCAP file, which has checksums, or the bag.

        Raises:
            FileNotFoundError: there is no bag.
            ValueError: the file has no index, or a damaged one.
        """
        is_directory = self.path.is_dir()
        files = sorted(self.path.glob("*.mcap")) if is_directory else [self.path]
        if is_directory and not files and not (self.path / "metadata.yaml").exists():
            what = "neither metadata.yaml nor an MCAP file"
            raise FileNotFoundError(f"{self.path} is no bag: it has {what}")
        if len(files) != 1 or files[0].suffix != ".mcap":
            return self.path
        check_index(files[0])
        return files[0]

    def _noted(self) -> str:
        """Return what the recorder has noted of why this is not all."""
        if not self.path.is_dir():
            return ""
        try:
            text = (self.path / "metadata.yaml").read_text("utf-8")
            custom = yaml.safe_load(text)["rosbag2_bagfile_information"].get("custom_data") or {}
            return str(custom.get(INCOMPLETE_KEY, ""))
        except (OSError, ValueError, LookupError, TypeError, AttributeError, yaml.YAMLError):
            return f"{self.path / 'metadata.yaml'} is missing or damaged"

    def _salvage(self, error: Exception) -> SalvagedBag:
        """Read what is whole.

        Raises:
            FileNotFoundError: there is no bag.
            AnyReaderError: there is none that could be salvaged.
        """
        reason = " ".join(str(error).split())
        try:
            bag = SalvagedBag(self.path)
        except OSError:
            if isinstance(error, OSError | AnyReaderError):
                raise error from None
            raise AnyReaderError(f"{self.path} cannot be read: {reason}") from error
        self.counts = dict(bag.counts)
        self.start, self.end = bag.start / 1e9, bag.end / 1e9
        damaged = f", {bag.lost_chunks} damaged chunks are left out" if bag.lost_chunks else ""
        self.damage = f"{self.path} is not whole ({reason}): {bag.counts.total()} messages{damaged}"
        self._salvaged = bag
        _log.warning("%s", self.damage)
        return bag

    def read(self, take: Callable[[Any], T]) -> T:
        """Return what a function makes of the open bag; it may be called twice.

        Args:
            take: of a reader as rosbags has it: `connections`, `typestore`, `messages(connections)`
                by log time [ns], undecoded.
        """
        if self._salvaged is None:
            try:
                with AnyReader([self._file]) as reader:
                    return take(reader)
            except Exception as error:
                self._salvage(error)
        return take(self._salvaged)

    def has(self, topic: str) -> bool:
        """Return whether there is any message of a topic."""
        return self.counts.get(self.full(topic), 0) > 0

    @property
    def namespace(self) -> str:
        """Of the robot whose clock is recorded; "" of one that is in none."""
        clock = graph.absolute(graph.CLOCK)
        robots = [name.removesuffix(clock) for name in self.counts if name.endswith(clock)]
        return min(robots, key=len, default="")

    def full(self, topic: str) -> str:
        """Return the full name of a topic of the graph, of the robot whose clock is recorded."""
        return graph.absolute(topic, self.namespace)
