// Sub-tile culling of the PIXEL shape: finds the blocks of a tile where a staged splat can be visible. Uses the test of
// the tile lists, with the same margins, on a grid of blocks. A splat that is not listed in a block has alpha <
// ALPHA_MIN at every pixel of the block in the arithmetic of blending, so skipping the splat changes no result.
#ifndef BLOCKS_GLSL
#define BLOCKS_GLSL

#include "tile.glsl"

// Pixels of a block, consecutive in the Morton order of a tile's pixels: a power of two from 8 to 256; 0: no culling.
layout(constant_id = 4) const uint BLOCK = 0u;

const uint BLOCK_PIXELS = BLOCK == 0u ? SIDE * SIDE : BLOCK;
const uint BLOCK_W = BLOCK_PIXELS <= 16u ? 4u : BLOCK_PIXELS <= 64u ? 8u : 16u;
const uint BLOCK_H = BLOCK_PIXELS / BLOCK_W;
const uint BLOCK_ROWS = SIDE / BLOCK_H;
const uint BLOCK_COLUMNS = SIDE / BLOCK_W;
const uint MOST_BLOCKS = 32u;
const uint TOUCH_WORDS = BATCH / 32u;
// Threads that share a staged splat's rows of blocks.
const uint TESTERS = LOCAL_SIZE / BATCH;

// Per block, a bit for each staged splat.
shared uint touched[MOST_BLOCKS * TOUCH_WORDS];

// The block in column x, row y of the tile's blocks: the inverse of pixel_place.
uint block_at(uint x, uint y) {
    const uvec2 p = uvec2(x * BLOCK_W, y * BLOCK_H);
    const uvec2 bits = (p & 1u) | (p & 2u) << 1u | (p & 4u) << 2u | (p & 8u) << 3u;
    return (bits.x | bits.y << 1u) / BLOCK_PIXELS;
}

// Called by all threads, with a barrier before touch_blocks and a barrier after the bits are read.
void clear_blocks() {
    const uint t = local_index();
    if (BLOCK != 0u && t < MOST_BLOCKS * TOUCH_WORDS) touched[t] = 0u;
}

// Marks the blocks that the staged splat `local_index() % BATCH` touches, in this thread's rows of blocks. `p`, `q`:
// the first eight floats of its row of splat2d.
void touch_blocks(vec4 p, vec4 q, uvec2 corner) {
    const uint staged = local_index() % BATCH;
    const TileGrid grid = TileGrid(uvec2(push.width, push.height), uvec2(BLOCK_W, BLOCK_H));
    const TileEllipse e = tile_ellipse(p.xy, vec3(p.zw, q.x), q.y, grid);
    const uvec2 first = corner / uvec2(BLOCK_W, BLOCK_H);
    for (uint y = local_index() / BATCH; y < BLOCK_ROWS; y += TESTERS) {
        if (first.y + y < e.row_begin || first.y + y >= e.row_end) continue;
        const uvec2 columns = tile_row(e, first.y + y, grid);
        for (uint x = 0u; x < BLOCK_COLUMNS; ++x) {
            if (first.x + x >= columns.x && first.x + x < columns.y) {
                atomicOr(touched[block_at(x, y) * TOUCH_WORDS + staged / 32u], 1u << staged % 32u);
            }
        }
    }
}

// Bits of the staged splats 32 word to 32 word + 31 that touch the block of a pixel.
uint touched_word(uint rank, uint word) { return touched[rank / BLOCK_PIXELS * TOUCH_WORDS + word]; }

#endif
