// Indices into the `counters` buffer; the same names stand in src/pass/counters.rs (compared by a test).
#ifndef COUNTERS_GLSL
#define COUNTERS_GLSL

const uint COUNTER_STATUS = 0u;       // STATUS_* bits, sticky until the host clears them
const uint COUNTER_SPLATS = 1u;       // splats in the model
const uint COUNTER_VISIBLE = 2u;      // splats on screen in this event
const uint COUNTER_PAIRS = 3u;        // (splat, tile) pairs of this event, counted past the capacity
const uint COUNTER_DONE = 4u;         // number of the last finished event
const uint COUNTER_WANT_PAIRS = 5u;   // largest pair count seen
const uint COUNTER_WANT_SPLATS = 6u;  // largest splat count asked for by density control
const uint COUNTER_BAD_SPLATS = 7u;   // splats with a non-finite value met since the start
const uint COUNTER_CLONED = 8u;       // by the last density change
const uint COUNTER_SPLIT = 9u;
const uint COUNTER_PRUNED = 10u;
const uint COUNTER_NEXT_ID = 11u;     // identity of the next splat to be born
const uint COUNTER_SCAN_TOTAL = 12u;  // total of the last prefix sum
const uint COUNTER_CONSTRAINED = 13u; // splats with an identity below it were there at the end of the low-frequency stage
const uint COUNTER_PLAIN = 14u;       // splats in the last rows, whose harmonics end at degree 1: the planes of the others end before them
const uint COUNTER_CAUGHT_UP = 15u;   // step of the optimiser, modulo 2^16, from which on all that a splat has missed counts
const uint COUNTER_COUNT = 16u;

const uint STATUS_PAIRS = 1u;         // more pairs than the pair buffers hold
const uint STATUS_SPLATS = 2u;        // more splats than the planes hold

// Rows from this one on have harmonics up to degree 1 alone.
#define FULL_ROWS (counters[COUNTER_SPLATS] - min(counters[COUNTER_PLAIN], counters[COUNTER_SPLATS]))

#endif
