"""The only place with sockets, serial lines and receipt stamps: wires to `Frames` and back."""
