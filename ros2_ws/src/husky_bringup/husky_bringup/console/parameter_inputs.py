"""One input of the page for a parameter: its kind, what stands beside it, what it may be set to."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

from viser import GuiApi, GuiEvent

from husky_bringup.node_parameter import NodeParameter, check_text, meaning, unit

_LONGEST, _SHOWN = 10_000, 200
"""Characters of a text, and of one that cannot be set."""
_WIDEST = 1000
"""Of a slider: its range in the smallest number that matters on it."""
_STEPS = 200
"""Of a slider, at least."""
_FINER = 4
"""Decades by which its steps may be finer, to hit the value."""
_DIGITS = 12
"""Behind the point, at most: viser takes the value's own, and lets nobody type more."""
_EXACT = 2**53
"""Whole numbers above are not exact in a browser."""
_TINY, _HUGE = 1e-9, 1e15
"""Floats beyond are typed as text: a browser writes them with too few digits."""


class ParameterInput:
    """An input; what is typed is sent by Enter, everything else with each change."""

    def __init__(self, gui: GuiApi, parameter: NodeParameter, send: Callable[[Any], None]):
        """Show a parameter; the input will be where in the page it is made.

        Args:
            gui: of the page.
            parameter: to show.
            send: takes what a browser has sent, in viser's thread; `accepted` tells what of it.
        """
        self._kind = kind_of(parameter)
        self._send = send
        self._parameter = parameter
        if self._kind in _TYPED:
            form = gui.add_form(None)
            with form:
                self._handle = _add(gui, self._kind, parameter)
            form.on_submit(self._on_change)
            self._whole: Any = form
        else:
            self._handle = self._whole = _add(gui, self._kind, parameter)
            self._handle.on_update(self._on_change)

    def show(self, value: Any) -> None:
        """Show a value of the same type."""
        if self._kind == "dropdown" and value not in self._handle.options:
            self._handle.options = (*self._handle.options, value)
        if self._kind == "slider":
            self._handle.step = slider_step(self._parameter.lower, self._parameter.upper, value)
        self._handle.value = as_shown(self._kind, value)

    def remove(self) -> None:
        """Leave the page."""
        self._whole.remove()

    # viser calls coroutines in the order in which the messages come, functions in any.
    async def _on_change(self, event: GuiEvent[Any]) -> None:
        if event.client is not None:
            self._send(self._handle.value)


_TYPED, _NUMBERS = ("number", "text", "list"), ("slider", "number")


def kind_of(parameter: NodeParameter) -> str:
    """Return the kind of input: checkbox, dropdown, slider, number, text, list, or fixed."""
    value = parameter.value
    if isinstance(value, bool):
        return "checkbox"
    if isinstance(value, int):
        return _kind_of_number(parameter) if abs(value) <= _EXACT else "text"
    if isinstance(value, float):
        plain = value == 0.0 or _TINY <= abs(value) <= _HUGE
        return _kind_of_number(parameter) if plain else "text"
    if isinstance(value, list):
        return "list" if len(as_shown("list", value)) <= _LONGEST else "fixed"
    if not isinstance(value, str):
        return "fixed"
    if parameter.choices:
        return "dropdown"
    # A field of one line would lose the others.
    return "text" if value.isprintable() and len(value) <= _LONGEST else "fixed"


def accepted(parameter: NodeParameter, given: Any) -> Any:
    """Return the value that a browser wants a parameter to have.

    Args:
        parameter: with a value of the type that is wanted.
        given: by a browser, so it may be anything.

    Raises:
        ValueError: it makes no sense; the node looks at the rest.
    """
    kind = kind_of(parameter)
    if parameter.read_only:
        raise ValueError("it is fixed at the start")
    if kind == "fixed":
        raise ValueError("it cannot be set here")
    if isinstance(given, str) and len(given) > _LONGEST:
        raise ValueError(f"{len(given)} characters, {_LONGEST} are allowed")
    if parameter.choices and kind == "dropdown" and given not in parameter.choices:
        raise ValueError(f"{given!r:.40} is none of {', '.join(parameter.choices)}")
    if kind == "list":
        value: Any = _list(given)
    elif kind == "text" and not isinstance(parameter.value, str):
        value = type(parameter.value)(str(given).strip())
    elif kind in _NUMBERS and isinstance(parameter.value, int):
        if not float(given).is_integer() or abs(given) > _EXACT:
            raise ValueError(f"{given} is no whole number of 53 bits")
        value = int(given)
    else:
        value = given
    for each in value if isinstance(value, list) else [value]:
        if isinstance(each, str):
            check_text(each)
        elif each != each:
            raise ValueError("NaN is no number")
    return value


def as_shown(kind: str, value: Any) -> Any:
    """Return what an input of a kind shows of a value."""
    if kind == "fixed":
        text = str(value) if value is not None else "not set"
        return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
    if kind == "list":
        return json.dumps(value, ensure_ascii=False)
    return str(value) if kind == "text" else value


def slider_step(lower: float | None, upper: float | None, value: float) -> float:
    """Return a step of a slider, 1, 2 or 5 times a power of ten, that hits a value if it can."""
    assert lower is not None and upper is not None
    if isinstance(value, int):
        return 1
    rough = (upper - lower) / _STEPS
    decade = 10.0 ** math.floor(math.log10(rough))
    step = max(decade * factor for factor in (1, 2, 5) if decade * factor <= rough * (1 + 1e-9))
    for finer in range(_FINER + 1):
        fine = float(step * 0.1**finer)
        rest = math.fmod(abs(value - lower), fine) if math.isfinite(value) else 0.0
        if min(rest, fine - rest) < 1e-6 * fine:
            break
    return fine


def _kind_of_number(parameter: NodeParameter) -> str:
    lower, upper, value = parameter.lower, parameter.upper, parameter.value
    if lower is None or upper is None or not lower <= value <= upper or lower == upper:
        return "number"
    if isinstance(value, int):
        return "slider" if upper - lower <= _WIDEST else "number"
    smallest = min(abs(each) for each in (lower, upper, value) if each != 0.0)
    wide = upper - lower > _WIDEST * smallest or math.isinf(upper - lower)
    return "number" if wide or upper - lower < _TINY else "slider"


def _list(given: Any) -> list[Any]:
    """Return a list of plain values that is written as JSON.

    Raises:
        ValueError: it is none.
    """
    try:
        found = json.loads(given)
    except (TypeError, RecursionError) as error:
        raise ValueError("it is no list") from error
    except json.JSONDecodeError as error:
        raise ValueError(f"it is no list as [1.0, 2.0]: {error}") from error
    plain = (bool, int, float, str)
    if not isinstance(found, list) or any(type(each) not in plain for each in found):
        raise ValueError("it is no list of numbers, texts, or true and false")
    return found


# On the page ----------------------------------------------------------------------------------
def _add(gui: GuiApi, kind: str, parameter: NodeParameter) -> Any:
    """Add an input to the page."""
    value, read_only = as_shown(kind, parameter.value), parameter.read_only
    label, hint = label_of(parameter), _hint(kind, parameter)
    look: dict[str, Any] = {"disabled": read_only or kind == "fixed", "hint": hint}
    if kind == "checkbox":
        return gui.add_checkbox(label, value, **look)
    if kind == "dropdown":
        known = parameter.choices
        options = known if value in known else (*known, value)
        return gui.add_dropdown(label, options, initial_value=value, **look)
    if kind in _NUMBERS:
        return _add_number(gui, kind, parameter, look)
    return gui.add_text(label, value, **look)


def _add_number(gui: GuiApi, kind: str, parameter: NodeParameter, look: dict[str, Any]) -> Any:
    lower, upper, value = parameter.lower, parameter.upper, parameter.value
    label, shown = label_of(parameter), float(value)
    # viser would make any float a browser sends a whole number, which may be too long to send on.
    if kind == "slider":
        assert lower is not None and upper is not None  # by `kind_of`
        step = slider_step(lower, upper, value)
        handle: Any = gui.add_slider(label, lower, upper, step, shown, **look)
    else:
        low = lower if lower is not None and -_EXACT <= lower <= value else None
        high = upper if upper is not None and value <= upper <= _EXACT else None
        handle = gui.add_number(label, shown, min=low, max=high, **look)
    handle.precision = 0 if isinstance(value, int) else _DIGITS
    return handle


def label_of(parameter: NodeParameter) -> str:
    """Return the last part of a name, with the unit."""
    name, of = parameter.name.rpartition(".")[2], unit(parameter)
    return f"{name} [{of}]" if of else name


def _hint(kind: str, parameter: NodeParameter) -> str:
    parts = [meaning(parameter)]
    if parameter.lower is not None and parameter.upper is not None:
        parts.append(f"{parameter.lower:.10g} to {parameter.upper:.10g} {unit(parameter)}".strip())
    if parameter.allowed:
        parts.append(f"one of {parameter.allowed}" if parameter.choices else parameter.allowed)
    if parameter.read_only:
        parts.append("fixed at the start")
    elif kind in _TYPED:
        parts.append("Enter sets it")
    return "; ".join(part for part in parts if part)
