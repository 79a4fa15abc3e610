"""ROS parameters from declarations: declared, checked, and changed all together or not at all."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from functools import partial
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService

from trunk_core.parameters.declarations import (
    ONLY_PLANNED,
    Declaration,
    ParameterError,
    Value,
    build,
    changed,
    check,
    declarations,
    is_qos_override,
    of_every_node,
    only_planned,
    table_of,
    unknown_name,
    values_of,
    with_cells,
)
from trunk_core.parameters.to_si import meant

Config = TypeVar("Config")
ConfigClass = type[Config] | Callable[[Mapping[str, object]], type[Config]]

_TYPES = {
    "bool": Parameter.Type.BOOL,
    "integer": Parameter.Type.INTEGER,
    "double": Parameter.Type.DOUBLE,
    "string": Parameter.Type.STRING,
    "integer array": Parameter.Type.INTEGER_ARRAY,
    "double array": Parameter.Type.DOUBLE_ARRAY,
    "string array": Parameter.Type.STRING_ARRAY,
}


def descriptor(declaration: Declaration) -> ParameterDescriptor:
    """Return the descriptor of a declaration, as ``ros2 param describe`` shows it."""
    unit = f" [{declaration.unit}]" if declaration.unit else ""
    message = ParameterDescriptor(
        name=declaration.name,
        type=_TYPES[declaration.kind].value,
        description=declaration.description + unit,
        additional_constraints=declaration.allowed(),
        read_only=declaration.fixed,
    )
    low = declaration.above if declaration.minimum is None else declaration.minimum
    high = declaration.maximum
    if declaration.kind == "double" and (low, high) != (None, None):
        ends = -math.inf if low is None else low, math.inf if high is None else high
        message.floating_point_range = [
            FloatingPointRange(from_value=float(ends[0]), to_value=float(ends[1]))
        ]
    if declaration.kind == "integer" and (low, high) != (None, None):
        ends = -(2**63) if low is None else low, 2**63 - 1 if high is None else high
        message.integer_range = [
            IntegerRange(from_value=int(ends[0]), to_value=int(ends[1]), step=1)
        ]
    return message


def _text(parameter: Parameter) -> str:
    value = parameter.value
    return repr(list(value) if isinstance(value, array) else value)


def to_ros(declaration: Declaration, value: Value) -> Parameter:
    """Return a checked value as a ROS parameter of the declared type."""
    return Parameter(
        declaration.name,
        _TYPES[declaration.kind],
        list(value) if isinstance(value, tuple) else value,
    )


class NodeParameters(Generic[Config]):
    """A node's configuration, always equal to its stored ROS parameters."""

    def __init__(
        self,
        node: Node,
        config_class: ConfigClass[Config],
        on_change: Callable[[Config, Config], None],
        barred: Callable[[], str] = lambda: "",
    ) -> None:
        """Declare everything. Raises ParameterError for a bad value: the node is gone. Warns of odd names.

        ``config_class``: or a function that chooses it by the values given, of any type.

        ``barred`` returns why nothing may be changed now; empty if changes are allowed.
        A CSV file that only plans read is refused, not ignored.
        """
        self._node = node
        self._on_change = on_change
        self._barred = barred
        # The only place where rclpy keeps overrides of any type, and those that nothing declares.
        self._overrides: Mapping[str, object] = node._parameter_overrides
        try:
            self._class = self._chosen(config_class)
            self._declared = declarations(self._class)
            self.config = build(self._class, self._take_overrides())
        except ParameterError:
            node.destroy_node()  # nobody else can: its constructor will not return
            raise
        for name, value in values_of(self.config).items():
            self._declare(self._declared[name], value)
        node.add_pre_set_parameters_callback(self.prepared)
        node.add_on_set_parameters_callback(self._judge)
        node.add_post_set_parameters_callback(self._apply)
        _Services(node, self)

    def _chosen(self, config_class: ConfigClass[Config]) -> type[Config]:
        if isinstance(config_class, type):
            return config_class
        values = {name: getattr(o, "value", o) for name, o in self._overrides.items()}
        return config_class(values)

    def _take_overrides(self) -> dict[str, object]:
        """Return the values from files and the command line, of any type."""
        given: dict[str, object] = {}
        for name, override in self._overrides.items():
            value = getattr(override, "value", override)
            if only_planned(self._class, name):
                raise ParameterError(name, value, ONLY_PLANNED)
            if table_of(name, self._declared):
                given[name] = value
            elif name in self._declared:
                if value is not None:
                    given[name] = value
                elif self._declared[name].kind.endswith("array"):
                    given[name] = ()  # YAML's [] has no type in ROS 2 and arrives as "not set"
            # Files for several nodes contain, under "/**", many parameters that a node does not have; a
            # near miss is more likely a typo.
            elif not of_every_node(name):
                close = get_close_matches(name, list(self._declared), n=1, cutoff=0.85)
                if close:
                    self._node.get_logger().warning(
                        f"parameter {name!r} is ignored: no such parameter; did you mean {close[0]!r}?"
                    )
        return given

    def _declare(self, declaration: Declaration, value: Value) -> None:
        described = descriptor(declaration)
        ros_value = to_ros(declaration, value)
        if value == ():  # an empty list has no type of its own: declare the type, then set it
            self._node.declare_parameter(declaration.name, ros_value.type_, ignore_override=True)
            self._node.set_parameters([ros_value])
            self._node.set_descriptor(declaration.name, described)
        else:
            self._node.declare_parameter(
                declaration.name, ros_value.value, described, ignore_override=True
            )

    def prepared(self, changes: Sequence[Parameter]) -> list[Parameter]:
        """Return changes with integers for doubles, as at start, and tables for their cells.

        What is wrong is left as it is, to be refused.
        """
        return [self._coerced(change) for change in self._folded(changes)]

    def _folded(self, changes: Sequence[Parameter]) -> list[Parameter]:
        if not any(table_of(change.name, self._declared) for change in changes):
            return list(changes)
        given = {change.name: change.value for change in changes}
        try:
            values = with_cells(self._class, given, partial(values_of, self.config))
        except ParameterError:
            return list(changes)
        kept = [change for change in changes if change.name in values]
        tables = [name for name in values if given.get(name) is not values[name]]
        return [
            *(change for change in kept if change.name not in tables),
            *(to_ros(self._declared[name], values[name]) for name in tables),  # type: ignore[arg-type]
        ]

    def _coerced(self, change: Parameter) -> Parameter:
        declaration = self._declared.get(change.name)
        if declaration is None:
            return change
        try:
            value = meant(declaration, change.value, values_of(self.config)[change.name])
            return to_ros(declaration, check(declaration, value))
        except ParameterError:
            return change

    def unchanged(self, change: Parameter) -> bool:
        """Return True if the parameter, even one of rclpy's, already has this value."""
        if not self._node.has_parameter(change.name):
            return False
        now = self._node.get_parameter(change.name)
        # Compared as text: 0.0 and -0.0 are equal, but not the same.
        return now.type_ == change.type_ and _text(now) == _text(change)

    def _candidate(self, changes: Sequence[Parameter]) -> Any:
        known = (p for p in changes if p.name in self._declared or table_of(p.name, self._declared))
        return changed(self.config, {p.name: p.value for p in known})

    def refusal(self, changes: Sequence[Parameter]) -> str:
        """Return why these changes are refused as a set, naming every wrong value; empty if they are not.

        Linked values are checked together once each is valid by itself.
        """
        if reason := self._barred():
            return reason
        errors = []
        for change in changes:
            try:
                self._check(change)
            except ParameterError as error:
                errors.append(str(error))
        if not errors:
            try:
                self._candidate(changes)
            except ParameterError as error:
                errors.append(str(error))
        return "; ".join(errors)

    def _check(self, change: Parameter) -> None:
        declaration = self._declared.get(change.name)
        if declaration is not None:
            if declaration.fixed and not self.unchanged(change):
                now = self._node.get_parameter(change.name).value
                raise ParameterError(
                    change.name,
                    change.value,
                    f"fixed at start, to {now!r}; start the node with another value",
                )
            check(declaration, change.value)
        elif table_of(change.name, self._declared):
            with_cells(self._class, {change.name: change.value}, partial(values_of, self.config))
        elif not self._node.has_parameter(change.name):  # rclpy declares some of its own
            planned = only_planned(self._class, change.name)
            allowed = ONLY_PLANNED if planned else unknown_name(change.name, self._declared)
            raise ParameterError(change.name, change.value, allowed)

    def _judge(self, changes: list[Parameter]) -> SetParametersResult:
        """Accept or refuse changes made within this process, which do not go through a service.

        rclpy declares overrides of a topic's quality of service with the topic.
        """
        reason = self.refusal([c for c in changes if not is_qos_override(c.name)])
        return SetParametersResult(successful=not reason, reason=reason)

    def _apply(self, changes: list[Parameter]) -> None:
        if all(is_qos_override(change.name) for change in changes):
            return
        old, self.config = self.config, self._candidate(changes)
        self._on_change(old, self.config)


class _Services(ParameterService):
    """A node's parameter services: rclpy's, but with our own messages for refusals.

    rclpy checks types, ranges and fixed values against the descriptors before it calls any callback, and
    not all of its messages name the parameter; a type that ROS 2 does not know would end the node.
    Setting a parameter to its present value does nothing: `ros2 param load` of a node's dump sets all of
    them, even fixed ones, and must change nothing.
    """

    def __init__(self, node: Node, parameters: NodeParameters[Any]) -> None:
        self._parameters = parameters
        super().__init__(node)

    def _set_parameters_callback(
        self, request: SetParameters.Request, response: SetParameters.Response
    ) -> SetParameters.Response:
        response.results = [self._set([message]) for message in request.parameters]
        return response

    def _set_parameters_atomically_callback(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        response.result = self._set(request.parameters)
        return response

    def _set(self, messages: Sequence[ParameterMessage]) -> SetParametersResult:
        known = {kind.value for kind in Parameter.Type}
        strange = [message for message in messages if message.value.type not in known]
        if strange:
            reason = "; ".join(
                f"parameter {message.name!r}: {message.value.type} is not a parameter type"
                for message in strange
            )
            return SetParametersResult(successful=False, reason=reason)
        sent = [Parameter.from_parameter_msg(message) for message in messages]
        values = self._parameters.prepared(sent)
        reason = self._parameters.refusal(values)
        names_changed = {value.name for value in values if not self._parameters.unchanged(value)}
        changes = [value for value in values if value.name in names_changed]
        if reason or not changes:
            return SetParametersResult(successful=not reason, reason=reason)
        result = self._get_node().set_parameters_atomically(changes)
        if not result.successful:  # one of rclpy's own parameters
            names = ", ".join(repr(change.name) for change in changes)
            result.reason = f"parameter {names}: {result.reason}"
        return result
