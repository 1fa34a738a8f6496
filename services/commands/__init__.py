"""One file a sub-command of ``lacet``, found by walking this folder."""
