"""Services, all that has a main(), a socket, a thread or a file: acquisition, studies, planning, reports, workbench."""
