"""The committed generated code is what the schema says, and the schema in a log is complete."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool

from lacet.daq.formats.mcap_write import describe
from lacet.daq.schema import lacet_pb2 as pb
from tests.support.places import HOME

ROOT = HOME


def test_generated_code_is_up_to_date(tmp_path: Path):
    protoc = pytest.importorskip("grpc_tools.protoc")
    out = tmp_path / "lacet.desc"
    builtin = Path(sys.modules["grpc_tools"].__path__[0]) / "_proto"
    code = protoc.main(["", f"-I{ROOT}", f"-I{builtin}", f"--descriptor_set_out={out}", "daq/schema/lacet.proto"])
    assert code == 0
    made = FileDescriptorSet.FromString(out.read_bytes()).file[0]
    committed = FileDescriptorProto()
    pb.DESCRIPTOR.CopyToProto(committed)
    for file in (made, committed):  # names that the compiler derives and the runtime may leave out
        for message in file.message_type:
            for part in (message, *message.nested_type):
                for item in part.field:
                    item.ClearField("json_name")
    assert made == committed, "run the command at the head of daq/schema/lacet.proto"


@pytest.mark.parametrize("kind", [pb.RawFrames, pb.DecodedBlock, pb.StartRecord, pb.Sample], ids=lambda k: k.__name__)
def test_a_viewer_can_build_the_message_from_the_schema_alone(kind):
    pool = DescriptorPool()  # empty: knows nothing but what the schema brings, in the order it brings it
    for file in FileDescriptorSet.FromString(describe(kind)).file:
        pool.Add(file)
    found = pool.FindMessageTypeByName(kind.DESCRIPTOR.full_name)
    assert [item.name for item in found.fields] == [item.name for item in kind.DESCRIPTOR.fields]
