"""Live channels for Foxglove and Lichtblick: a websocket server of their protocol, fed by messages of the bus."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lacet.daq.blocks import Block
from lacet.daq.bus.listener import Message
from lacet.daq.channels import CHANNELS
from lacet.daq.errors import UsageError
from lacet.daq.formats.mcap_write import PROTOBUF, describe
from lacet.daq.formats.wire import WireError, block_from_bytes
from lacet.daq.schema import lacet_pb2 as pb
from lacet.services.exports.rows import sample

LAYOUT = Path(__file__).with_name("foxglove_layout.json")
"""The layout for the viewer: speed, wheel loads, suspension, body and the state of the recording."""

SAMPLES_PER_SECOND = 50.0
"""Most samples of a channel that are shown [1/s]: more than a screen draws; the log has them all."""

LEDGER = "/lacet/ledger"
"""Topic of rates, losses and states of the sensors, as JSON."""


class LiveViewer:
    """Websocket server that shows the runs of a bus, sample by sample, under the topics of ``lacet export --rows``.

    Parameters
    ----------
    host, port : where it listens; port 0 for any free one.
    sdk : the module `foxglove`.

    Raises UsageError when the address cannot be had.
    """

    def __init__(self, host: str, port: int, sdk: Any):
        self._sdk, self._context = sdk, sdk.Context()
        try:
            self._server = sdk.start_server(name="lacet", host=host, port=port, context=self._context)
        except Exception as error:  # the package has no error of its own for it
            raise UsageError(
                f"cannot listen on {host}:{port} ({error}): give another with --listen HOST:PORT"
            ) from None
        self.port: int = self._server.port
        self.messages = 0
        """Number of samples and ledgers given to viewers."""
        self._channels: dict[str, Any] = {}
        self._passed: dict[str, int] = {}

    def take(self, message: Message) -> None:
        """Show a message of the bus; one that cannot be read is left out."""
        try:
            if message.kind == "block":
                self._block(block_from_bytes(message.payload)[0])
            elif message.kind == "ledger":
                self._ledger(json.loads(message.payload))
        except (WireError, ValueError, RecursionError):
            pass

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    def _block(self, block: Block) -> None:
        name = block.channel
        step = max(1, round(CHANNELS[name].rate / SAMPLES_PER_SECOND))
        first = -self._passed.get(name, 0) % step
        self._passed[name] = self._passed.get(name, 0) + len(block)
        channel = self._channel("/" + name.replace(".", "/"), PROTOBUF, pb.Sample)
        if not channel.has_sinks():
            return
        rows = zip(block.t_ns[first::step], block.values[first::step], block.flags[first::step], strict=True)
        for t_ns, values, flags in rows:
            data = sample(name, int(t_ns), values.tolist(), int(flags)).SerializeToString(deterministic=True)
            channel.log(data, log_time=max(0, int(t_ns)))
            self.messages += 1

    def _ledger(self, ledger: Mapping[str, Any]) -> None:
        if isinstance(ledger, dict):
            self._channel(LEDGER, "json", None).log(json.dumps(ledger).encode())
            self.messages += 1

    def _channel(self, topic: str, encoding: str, kind: Any) -> Any:
        if topic not in self._channels:
            schema = kind and self._sdk.Schema(name=kind.DESCRIPTOR.full_name, encoding=PROTOBUF, data=describe(kind))
            self._channels[topic] = self._sdk.Channel(
                topic, schema=schema, message_encoding=encoding, context=self._context
            )
        return self._channels[topic]
