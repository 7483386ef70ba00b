// Indices into the `counters` buffer; src/pass/counters.rs has the same names (compared by a test).
#ifndef COUNTERS_GLSL
#define COUNTERS_GLSL

const uint COUNTER_STATUS = 0u;       // STATUS_* bits, sticky until the host clears them
const uint COUNTER_SPLATS = 1u;       // splats in the model
const uint COUNTER_VISIBLE = 2u;      // visible splats in this event
const uint COUNTER_PAIRS = 3u;        // (splat, tile) pairs of this event, including pairs beyond the capacity
const uint COUNTER_DONE = 4u;         // number of the last finished event
const uint COUNTER_WANT_PAIRS = 5u;   // largest pair count seen
const uint COUNTER_WANT_SPLATS = 6u;  // largest splat count that density control has requested
const uint COUNTER_BAD_SPLATS = 7u;   // encountered splats with a non-finite value since the start
const uint COUNTER_CLONED = 8u;       // by the last density change
const uint COUNTER_SPLIT = 9u;
const uint COUNTER_PRUNED = 10u;
const uint COUNTER_NEXT_ID = 11u;     // identity of the next new splat
const uint COUNTER_SCAN_TOTAL = 12u;  // total of the last prefix sum
const uint COUNTER_CONSTRAINED = 13u; // splats with a lower identity existed at the end of the low-frequency stage
const uint COUNTER_PLAIN = 14u;       // number of splats, in the last rows, without sh coefficients above degree 1
const uint COUNTER_CAUGHT_UP = 15u;   // optimiser step, modulo 2^16, from which on missed steps count
const uint COUNTER_COUNT = 16u;

const uint STATUS_PAIRS = 1u;         // more pairs than the pair buffers hold
const uint STATUS_SPLATS = 2u;        // more splats than the planes hold

// Splats with sh coefficients above degree 1; later rows have coefficients only up to degree 1.
#define FULL_ROWS (counters[COUNTER_SPLATS] - min(counters[COUNTER_PLAIN], counters[COUNTER_SPLATS]))

#endif
