"""The door itself: a function that holds its arguments against its signature."""

from __future__ import annotations

import inspect
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

from grainsdem.errors import ArgumentError, ShapeError, shown
from grainsdem.gate.kinds import UnfitError
from grainsdem.gate.shapes import hold_shapes, shapes_of
from grainsdem.gate.types import checks_of

if TYPE_CHECKING:
    from collections.abc import Callable, Container

    from grainsdem.gate.kinds import Check
    from grainsdem.gate.shapes import Shapes

    Function = TypeVar("Function", bound=Callable[..., Any])
    Kind = TypeVar("Kind", bound=type)


def gated(function: Function, *, leave: Container[str] = ()) -> Function:
    """Return a function that holds its arguments against its signature before it does anything.

    Parameters
    ----------
    function : callable
        Its types and its docstring are what counts.
    leave : container of str
        Arguments that it checks all by itself.

    Returns
    -------
    callable
        The same to whoever calls it rightly.

    Raises
    ------
    ArgumentError
        By the function that is returned, where an argument is of a kind that its signature does not have.
    ShapeError
        Where it cannot be made an array of real numbers.

    Examples
    --------
    >>> @gated
    ... def half(size: float) -> float:
    ...     return size / 2
    >>> half(np.float32(3))
    1.5
    >>> half("3")
    Traceback (most recent call last):
        ...
    grainsdem.errors.ArgumentError: size must be a number; got '3'
    """
    parameters = inspect.signature(function).parameters.values()
    names = [parameter.name for parameter in parameters]
    rest = next((parameter.name for parameter in parameters if parameter.kind is parameter.VAR_POSITIONAL), "")
    words: dict[str, str] = {}
    checks: dict[str, Check] = {}
    shapes = shapes_of(function)

    @wraps(function)
    def held(*args: Any, **kwargs: Any) -> Any:
        # Read at the first call: a room is not yet whole while its functions are made.
        if not words:
            known = {name: one for name, one in checks_of(function).items() if name not in leave}
            checks.update({name: check for name, (_, check) in known.items()})
            words.update({name: allowed for name, (allowed, _) in known.items()} or {"": ""})
        given, name = list(args), ""
        try:
            for number, value in enumerate(args):
                name = names[number] if number < len(names) else rest
                if name in checks:
                    given[number] = checks[name](value)
            for name, value in kwargs.items():
                if name in checks:
                    kwargs[name] = checks[name](value)
        except UnfitError as unfit:
            reason = unfit.args[0] if unfit.args else f"got {shown(kwargs.get(name, value))}"
        else:
            if shapes:
                _shape(shapes, names, given, kwargs)
            return function(*given, **kwargs)
        kind = ShapeError if words[name].startswith("an array") else ArgumentError
        raise kind(f"{name} must be {words[name]}; {reason}")

    return held  # type: ignore[return-value]  # it takes and returns what the function does


def _shape(shapes: Shapes, names: list[str], given: list[Any], kwargs: dict[str, Any]) -> None:
    """Hold arrays against their shapes, and put no rows in the place of each empty list that stands for them."""
    for name, rows in hold_shapes(shapes, {**dict(zip(names, given, strict=False)), **kwargs}).items():
        if name in kwargs:
            kwargs[name] = rows
        else:
            given[names.index(name)] = rows


def gated_noun(kind: Kind) -> Kind:
    """Return a data class of which the constructor and the public methods hold what they are given.

    Shapes of fields are its own business: they hang on one another in ways that a docstring cannot say. Methods that
    take nothing stay as they are, and so do those without a docstring, which are nobody's but the class's own.
    """
    kind.__init__ = gated(kind.__init__)  # type: ignore[misc]
    for name, method in list(vars(kind).items()):
        is_of_class = isinstance(method, classmethod)
        function = method.__func__ if is_of_class else method
        if name.startswith("_") or not inspect.isfunction(function) or not function.__doc__:
            continue
        if len(inspect.signature(function).parameters) > 1:
            setattr(kind, name, classmethod(gated(function)) if is_of_class else gated(function))
    return kind
