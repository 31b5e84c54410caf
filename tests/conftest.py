"""For all tests: threads wait as in the solver's own process."""

from solver.threads import let_idle_threads_sleep

let_idle_threads_sleep()
