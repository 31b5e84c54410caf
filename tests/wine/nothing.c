/* A library of forwarders alone. */
int nothing;
