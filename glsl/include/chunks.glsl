// Chunks of a tile's list, in the PIXEL shape: blend_backward walks the chunks of a long list in parallel. For that
// blend_forward keeps each pixel's state at the end of every chunk but the last: the colour that later chunks add, and
// the transmittance. The colours are summed from the back, so that nothing cancels.
#ifndef CHUNKS_GLSL
#define CHUNKS_GLSL

// Most chunks of a list; 1: lists are walked whole, and there are no states.
layout(constant_id = 7) const uint CHUNKS = 1u;

// Rows of four numbers in a state; the second row has depth and normal.
const uint STATE_ROWS = AUX != 0u ? 2u : 1u;

// Splats of a chunk of a list of `count` splats: whole batches.
uint chunk_splats(uint count) { return BATCH * max((count + BATCH * CHUNKS - 1u) / (BATCH * CHUNKS), 1u); }

// Index in `states` of a pixel's state at the end of a chunk.
uint state_at(uint tile, uint chunk, uvec2 place) {
    return ((tile * (CHUNKS - 1u) + chunk) * (SIDE * SIDE) + place.y * SIDE + place.x) * STATE_ROWS;
}

#endif
