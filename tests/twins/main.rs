//! Every registered pass against its twin.
