// Blocks of the pixels of a tile, in the PIXEL shape. A splat that cannot be visible in a block is skipped there:
// blend_forward finds the blocks of each splat by the test of the tile lists, with the same margins, and keeps a bit for
// each (splat, block) of a tile's list, which blend_backward reads. A skipped splat has alpha < ALPHA_MIN at every pixel
// of the block in the arithmetic of blending, so skipping the splat changes no result.
#ifndef BLOCKS_GLSL
#define BLOCKS_GLSL

// Pixels of a block: a power of two from 8 to 256, best the subgroup width; 0: no splat is skipped.
#ifdef SUBGROUP_EMULATED
const uint BLOCK = 0u;
#else
layout(constant_id = 4) const uint BLOCK = 0u;
#endif

const uint BLOCK_PIXELS = BLOCK == 0u ? 128u : BLOCK;
const uint BLOCK_W = BLOCK_PIXELS <= 16u ? 4u : BLOCK_PIXELS <= 64u ? 8u : 16u;
const uint BLOCK_H = BLOCK_PIXELS / BLOCK_W;
const uint BLOCK_ROWS = SIDE / BLOCK_H;
const uint BLOCK_COLUMNS = SIDE / BLOCK_W;
const uint BLOCKS = BLOCK_ROWS * BLOCK_COLUMNS;
const uint MOST_BLOCKS = 32u;
// Words of a batch, a bit for each staged splat.
const uint TOUCH_WORDS = BATCH / 32u;

// Per block, a bit for each staged splat that touches the block.
shared uint touched[MOST_BLOCKS * TOUCH_WORDS];

// Position in the tile of pixel `k` of a block. Blocks are numbered down the columns, so the next block but for the last
// of a column lies below.
uvec2 pixel_place(uint block, uint k) {
    return uvec2(block / BLOCK_ROWS * BLOCK_W + k % BLOCK_W, block % BLOCK_ROWS * BLOCK_H + k / BLOCK_W);
}

// Index in `masks` of the bits of splats 32 word to 32 word + 31 of a tile's list, for one block. `begin` is the first
// pair of the list. No two lists share a word: each has one word more than its pairs fill.
uint mask_at(uint tile, uint begin, uint word, uint block) { return (begin / 32u + tile + word) * BLOCKS + block; }

#endif
