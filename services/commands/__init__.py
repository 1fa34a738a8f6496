"""Sub-commands of ``lacet``, one file each, found automatically in this folder."""
