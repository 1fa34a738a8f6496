"""The stories of docs/stories: pages whose commands are run and whose printed numbers are checked."""
