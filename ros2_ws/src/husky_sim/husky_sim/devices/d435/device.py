"""A RealSense D435 to talk to: depth images from its optics in, frames as bytes out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from husky_description.sections import D435Section
from husky_drivers.d435.frames import DepthFrame, DepthImage
from husky_drivers.d435.wire import START, TAKEN_SIZE, encode, taken_numbers
from husky_sim.devices.d435.errors import SmoothNoise
from husky_sim.devices.d435.optics import intrinsics_of

FAULTS = {
    "freeze": (0.0, "no frames"),
    "stuck": (0.0, "the last image again and again, with new numbers and times"),
    "cover": (0.0, "something lies on the lens: no depth anywhere"),
    "dirt": (0.2, "a spot on this share of the image has random depth of 0.2 to 0.5 m, 0 to 1"),
    "garbage": (0.5, "this share of the frames has damaged bytes on the wire, 0 to 1"),
    "noise": (0.3, "this share of the pixels has random depth over the range, 0 to 1"),
    "power_cycle": (0.0, "once: the camera starts again and counts its frames from 0"),
}
"""Faults: default intensity, and what they do."""

DIRT_DEPTH = 200, 500
"""Least and greatest depth that dirt is taken for [mm]; assumed."""

_TRANSMIT_BUFFER = 1 << 20
"""Bytes that may wait to be sent before frames are lost."""
_MILLIMETRE = 0.001
_DAMAGED_BYTES = 8
"""Of a frame that arrives as garbage, at most."""
_SPOT = 8.0
"""Height of the image in radii of a spot of dirt."""
_FAULTS_DRAW, _SPOTS_DRAW = 1, 2
"""Last part of a generator's seed, behind that of the image; numpy ignores a 0 there."""


class D435Device:
    """Stands for the camera behind its lens: its wire (`husky_drivers.d435.wire`) and its faults.

    The owner of the wire hands in the host's bytes with `feed` and carries `take_output` to the
    host. `D435Optics` makes the images, possibly in another thread; the owner calls `send` when the
    latency of an image is over. The camera exposes from the world's time 0 on, whenever the host
    starts to listen: frame k depends on the seed, the scene, the fault and k, not on the host.

    Attributes:
        figures: of the camera.
        intrinsics: of its images.
        streaming: whether the host has asked for frames.
        taken: number of the last frame that the host has taken, -1 before.
    """

    def __init__(self, figures: D435Section, seed: int = 0):
        """Power the camera on; the seed is of the randomness of faults."""
        self.figures = figures
        self.intrinsics = intrinsics_of(figures)
        self.streaming = False
        self._fault, self._intensity = "", 0.0
        self._next_frame = 0
        self._heard = b""
        self._output = bytearray()
        self.restart(seed)

    def restart(self, seed: int) -> None:
        """Begin at the world's time 0 again; frame numbers go on, a host listens on, a fault stays.

        Numbers that do not come twice keep a late `taken` from answering a new frame.
        """
        self._seed = seed
        self._last: DepthImage | None = None
        self._spot: NDArray[np.bool_] | None = None
        # Image that is frame 0, None for the next one.
        self._first: int | None = -self._next_frame
        self.taken = -1

    def hang_up(self) -> None:
        """Take in that the host has gone: it gets nothing until it says START again."""
        self.streaming = False
        self._heard = b""
        self._output.clear()

    # The wire -----------------------------------------------------------------------------------
    def feed(self, data: bytes) -> None:
        """Take bytes from the host; any bytes."""
        heard = self._heard + data
        self.streaming = self.streaming or START in heard
        numbers = taken_numbers(heard)
        if numbers:
            self.taken = numbers[-1]
        self._heard = heard[1 - TAKEN_SIZE :]

    def take_output(self) -> bytes:
        """Return the bytes to the host since the last call."""
        output = bytes(self._output)
        self._output.clear()
        return output

    def send(self, number: int, time_ns: int, image: DepthImage) -> int | None:
        """Send an image, as the fault of now leaves it.

        Args:
            number: of the image, counted from the world's time 0.
            time_ns: time of the world in the middle of the exposure [ns].
            image: from `D435Optics.image` [mm].

        Returns:
            Number of the frame, for which the host will say `taken`; None if it gets none that is
            whole: it does not listen, or the fault or a full buffer holds the frame back.
        """
        if self._first is None:
            self._first = number
        frame_number = number - self._first
        self._next_frame = frame_number + 1
        if self._fault != "stuck" or self._last is None:
            self._last = image
        if not self.streaming or self._fault == "freeze" or len(self._output) >= _TRANSMIT_BUFFER:
            return None
        generator = self._generator(number, _FAULTS_DRAW)
        depth = self._spoil(self._last, generator)
        frame = DepthFrame(frame_number, 1e-6 * time_ns, self.intrinsics, _MILLIMETRE, depth)
        data = encode(frame)
        damaged = self._fault == "garbage" and generator.random() < self._intensity
        self._output += _damage(data, generator) if damaged else data
        return None if damaged else frame_number

    # Faults -------------------------------------------------------------------------------------
    def inject(self, fault: str, intensity: float | None = None) -> None:
        """Make the camera fail, until another fault or "" is injected.

        Args:
            fault: one of `FAULTS`; "" clears.
            intensity: how strong, 0 to 1, see `FAULTS`; None for the default.

        Raises:
            ValueError: no such fault, or an intensity that is out of range.
        """
        if fault and fault not in FAULTS:
            raise ValueError(f"no fault {fault!r}; there are {', '.join(FAULTS)}")
        if intensity is not None and not 0.0 <= intensity <= 1.0:
            raise ValueError(f"intensity of {fault} is {intensity}, it must be within 0 and 1")
        default = FAULTS[fault][0] if fault else 0.0
        self._intensity = default if intensity is None else intensity
        self._fault = fault if fault != "power_cycle" else ""
        self._spot = None
        if fault == "power_cycle":
            self._last, self._first, self._next_frame, self.taken = None, None, 0, -1

    def _spoil(self, image: DepthImage, generator: np.random.Generator) -> DepthImage:
        """Return an image as the fault of now leaves it."""
        if self._fault == "cover":
            return np.zeros_like(image)
        if self._fault == "dirt":
            least, greatest = DIRT_DEPTH
            wrong = self._dirty(image.shape)
        elif self._fault == "noise":
            least, greatest = np.rint(1e3 * self.figures.range).astype(int).tolist()
            wrong = generator.random(image.shape) < self._intensity
        else:
            return image
        depth = generator.integers(least, min(greatest, 65535), image.shape, np.uint16, True)
        return np.where(wrong, depth, image)

    def _dirty(self, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Return where the dirt is: spots that are the seed's, and grow with the intensity."""
        if self._spot is None:
            height, width = shape
            thickness = SmoothNoise(height, width, height / _SPOT).draw(
                self._generator(0, _SPOTS_DRAW)
            )
            count = round(self._intensity * thickness.size)
            self._spot = np.zeros(shape, bool)
            self._spot.flat[np.argsort(thickness, axis=None)[thickness.size - count :]] = True
        return self._spot

    def _generator(self, number: int, draw: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, 435, number, draw])


def _damage(data: bytes, generator: np.random.Generator) -> bytes:
    """Return a frame some bytes of which are others."""
    damaged = np.frombuffer(data, np.uint8).copy()
    count = generator.integers(1, _DAMAGED_BYTES, endpoint=True)
    where = generator.choice(damaged.size, count, replace=False)
    damaged[where] ^= generator.integers(1, 255, count, np.uint8, True)
    return damaged.tobytes()
