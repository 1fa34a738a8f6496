import datetime

from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class RawFrames(_message.Message):
    __slots__ = ("source", "sequence", "first_ns", "delta_ns", "ident", "length", "data")
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    FIRST_NS_FIELD_NUMBER: _ClassVar[int]
    DELTA_NS_FIELD_NUMBER: _ClassVar[int]
    IDENT_FIELD_NUMBER: _ClassVar[int]
    LENGTH_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    source: str
    sequence: int
    first_ns: int
    delta_ns: _containers.RepeatedScalarFieldContainer[int]
    ident: _containers.RepeatedScalarFieldContainer[int]
    length: _containers.RepeatedScalarFieldContainer[int]
    data: bytes
    def __init__(self, source: _Optional[str] = ..., sequence: _Optional[int] = ..., first_ns: _Optional[int] = ..., delta_ns: _Optional[_Iterable[int]] = ..., ident: _Optional[_Iterable[int]] = ..., length: _Optional[_Iterable[int]] = ..., data: _Optional[bytes] = ...) -> None: ...

class DecodedBlock(_message.Message):
    __slots__ = ("channel", "sequence", "unit", "axes", "first_ns", "delta_ns", "component", "flags", "device_first_ns", "device_delta_ns")
    class Component(_message.Message):
        __slots__ = ("name", "value")
        NAME_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        name: str
        value: _containers.RepeatedScalarFieldContainer[float]
        def __init__(self, name: _Optional[str] = ..., value: _Optional[_Iterable[float]] = ...) -> None: ...
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    AXES_FIELD_NUMBER: _ClassVar[int]
    FIRST_NS_FIELD_NUMBER: _ClassVar[int]
    DELTA_NS_FIELD_NUMBER: _ClassVar[int]
    COMPONENT_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    DEVICE_FIRST_NS_FIELD_NUMBER: _ClassVar[int]
    DEVICE_DELTA_NS_FIELD_NUMBER: _ClassVar[int]
    channel: str
    sequence: int
    unit: str
    axes: str
    first_ns: int
    delta_ns: _containers.RepeatedScalarFieldContainer[int]
    component: _containers.RepeatedCompositeFieldContainer[DecodedBlock.Component]
    flags: bytes
    device_first_ns: int
    device_delta_ns: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, channel: _Optional[str] = ..., sequence: _Optional[int] = ..., unit: _Optional[str] = ..., axes: _Optional[str] = ..., first_ns: _Optional[int] = ..., delta_ns: _Optional[_Iterable[int]] = ..., component: _Optional[_Iterable[_Union[DecodedBlock.Component, _Mapping]]] = ..., flags: _Optional[bytes] = ..., device_first_ns: _Optional[int] = ..., device_delta_ns: _Optional[_Iterable[int]] = ...) -> None: ...

class StartRecord(_message.Message):
    __slots__ = ("format", "run_id", "started_ns", "vehicle", "vehicle_text", "rig_text", "documents", "manoeuvre", "wheel_reference", "brakes", "notes", "software", "extra")
    class DocumentsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    class ExtraEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    STARTED_NS_FIELD_NUMBER: _ClassVar[int]
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    VEHICLE_TEXT_FIELD_NUMBER: _ClassVar[int]
    RIG_TEXT_FIELD_NUMBER: _ClassVar[int]
    DOCUMENTS_FIELD_NUMBER: _ClassVar[int]
    MANOEUVRE_FIELD_NUMBER: _ClassVar[int]
    WHEEL_REFERENCE_FIELD_NUMBER: _ClassVar[int]
    BRAKES_FIELD_NUMBER: _ClassVar[int]
    NOTES_FIELD_NUMBER: _ClassVar[int]
    SOFTWARE_FIELD_NUMBER: _ClassVar[int]
    EXTRA_FIELD_NUMBER: _ClassVar[int]
    format: str
    run_id: str
    started_ns: int
    vehicle: str
    vehicle_text: str
    rig_text: str
    documents: _containers.ScalarMap[str, str]
    manoeuvre: str
    wheel_reference: str
    brakes: str
    notes: str
    software: str
    extra: _containers.ScalarMap[str, str]
    def __init__(self, format: _Optional[str] = ..., run_id: _Optional[str] = ..., started_ns: _Optional[int] = ..., vehicle: _Optional[str] = ..., vehicle_text: _Optional[str] = ..., rig_text: _Optional[str] = ..., documents: _Optional[_Mapping[str, str]] = ..., manoeuvre: _Optional[str] = ..., wheel_reference: _Optional[str] = ..., brakes: _Optional[str] = ..., notes: _Optional[str] = ..., software: _Optional[str] = ..., extra: _Optional[_Mapping[str, str]] = ...) -> None: ...

class Losses(_message.Message):
    __slots__ = ("cause",)
    class CauseEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    CAUSE_FIELD_NUMBER: _ClassVar[int]
    cause: _containers.ScalarMap[str, int]
    def __init__(self, cause: _Optional[_Mapping[str, int]] = ...) -> None: ...

class StopRecord(_message.Message):
    __slots__ = ("stopped_ns", "reason", "counts", "losses")
    class CountsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    class LossesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: Losses
        def __init__(self, key: _Optional[str] = ..., value: _Optional[_Union[Losses, _Mapping]] = ...) -> None: ...
    STOPPED_NS_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    COUNTS_FIELD_NUMBER: _ClassVar[int]
    LOSSES_FIELD_NUMBER: _ClassVar[int]
    stopped_ns: int
    reason: str
    counts: _containers.ScalarMap[str, int]
    losses: _containers.MessageMap[str, Losses]
    def __init__(self, stopped_ns: _Optional[int] = ..., reason: _Optional[str] = ..., counts: _Optional[_Mapping[str, int]] = ..., losses: _Optional[_Mapping[str, Losses]] = ...) -> None: ...

class Manifest(_message.Message):
    __slots__ = ("run_id", "channel", "source", "losses")
    class Entry(_message.Message):
        __slots__ = ("name", "messages", "samples", "checksum")
        NAME_FIELD_NUMBER: _ClassVar[int]
        MESSAGES_FIELD_NUMBER: _ClassVar[int]
        SAMPLES_FIELD_NUMBER: _ClassVar[int]
        CHECKSUM_FIELD_NUMBER: _ClassVar[int]
        name: str
        messages: int
        samples: int
        checksum: int
        def __init__(self, name: _Optional[str] = ..., messages: _Optional[int] = ..., samples: _Optional[int] = ..., checksum: _Optional[int] = ...) -> None: ...
    class LossesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: Losses
        def __init__(self, key: _Optional[str] = ..., value: _Optional[_Union[Losses, _Mapping]] = ...) -> None: ...
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    CHANNEL_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    LOSSES_FIELD_NUMBER: _ClassVar[int]
    run_id: str
    channel: _containers.RepeatedCompositeFieldContainer[Manifest.Entry]
    source: _containers.RepeatedCompositeFieldContainer[Manifest.Entry]
    losses: _containers.MessageMap[str, Losses]
    def __init__(self, run_id: _Optional[str] = ..., channel: _Optional[_Iterable[_Union[Manifest.Entry, _Mapping]]] = ..., source: _Optional[_Iterable[_Union[Manifest.Entry, _Mapping]]] = ..., losses: _Optional[_Mapping[str, Losses]] = ...) -> None: ...

class Document(_message.Message):
    __slots__ = ("kind", "run_id", "sequence", "json")
    KIND_FIELD_NUMBER: _ClassVar[int]
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    JSON_FIELD_NUMBER: _ClassVar[int]
    kind: str
    run_id: str
    sequence: int
    json: str
    def __init__(self, kind: _Optional[str] = ..., run_id: _Optional[str] = ..., sequence: _Optional[int] = ..., json: _Optional[str] = ...) -> None: ...

class Sample(_message.Message):
    __slots__ = ("timestamp", "value", "x", "y", "z", "roll", "pitch", "yaw", "flags", "unit")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    ROLL_FIELD_NUMBER: _ClassVar[int]
    PITCH_FIELD_NUMBER: _ClassVar[int]
    YAW_FIELD_NUMBER: _ClassVar[int]
    FLAGS_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    timestamp: _timestamp_pb2.Timestamp
    value: float
    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float
    flags: int
    unit: str
    def __init__(self, timestamp: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., value: _Optional[float] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ..., roll: _Optional[float] = ..., pitch: _Optional[float] = ..., yaw: _Optional[float] = ..., flags: _Optional[int] = ..., unit: _Optional[str] = ...) -> None: ...
