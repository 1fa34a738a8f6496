"""Everything with a main(): acquisition, workspace, planning, render, reproduction, then workbench and commands."""
