//! A model with moments and statistics for density tests, as rows and as the planes of the device.

use psrgs_vk::pass::counters;
use psrgs_vk::scene::random::Random;

use super::harness::Words;

/// Floats per splat of each model plane: means, quats, scales, opacities, sh0 to sh3.
pub(crate) const WIDTHS: [usize; 8] = [3, 4, 3, 1, 12, 12, 12, 12];
pub(crate) const MEANS: usize = 0;
pub(crate) const QUATS: usize = 1;
pub(crate) const SCALES: usize = 2;
pub(crate) const OPACITIES: usize = 3;

/// A splat with parameters, moments, statistics and identity.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Row {
    pub(crate) planes: [Vec<f32>; 8],
    /// First moments of the planes, then second moments.
    pub(crate) moments: [Vec<f32>; 16],
    pub(crate) stats: [f32; 4],
    /// Mask value times absolute gradient, and number of views with a large error.
    pub(crate) scores: [f32; 2],
    pub(crate) id: u32,
}

/// The buffers that a density change reads and writes and that outlive it, with room for `capacity` splats.
#[derive(Clone, Debug)]
pub(crate) struct Model {
    pub(crate) capacity: usize,
    pub(crate) planes: [Vec<u32>; 8],
    pub(crate) moments: [Vec<u32>; 16],
    pub(crate) stats: Vec<u32>,
    pub(crate) scores: Vec<u32>,
    pub(crate) ids: Vec<u32>,
    pub(crate) counters: [u32; counters::COUNT],
}

/// Uniform in [low, high).
pub(crate) fn uniform(random: &mut Random, low: f32, high: f32) -> f32 {
    low + (high - low) * (random.word() as f32 / 4_294_967_296.0)
}

/// A whole number from 0 to n - 1.
pub(crate) fn below(random: &mut Random, n: usize) -> usize {
    random.word() as usize % n
}

impl Row {
    /// Random values; scales around 1 and opacities around a half, so that thresholds can lie on either side.
    pub(crate) fn random(random: &mut Random, id: u32) -> Self {
        let mut planes = WIDTHS.map(|w| (0..w).map(|_| uniform(random, -1.0, 1.0)).collect::<Vec<f32>>());
        planes[QUATS][0] += 0.1;
        let views = below(random, 4) as f32;
        Self {
            moments: std::array::from_fn(|p| (0..WIDTHS[p % 8]).map(|_| uniform(random, -1.0, 1.0)).collect()),
            stats: [
                views * uniform(random, 0.0, 1.0),
                views * uniform(random, 0.0, 2.0),
                views,
                uniform(random, 0.0, 9.0),
            ],
            scores: [views * uniform(random, 0.0, 2.0), below(random, 1 + views as usize) as f32],
            planes,
            id,
        }
    }

    /// Sets the score, the largest scale (with smaller ones beside it) and the opacity's logit.
    pub(crate) fn with(mut self, score: f32, views: f32, log_scale: f32, logit: f32) -> Self {
        self.stats = [score * views, 2.0 * score * views, views, 1.0];
        self.planes[SCALES] = vec![log_scale - 1.0, log_scale, log_scale - 0.5];
        self.planes[OPACITIES] = vec![logit];
        self
    }
}

/// Puts rows into planes.
impl Model {
    /// Fills the spare room with words whose use would show, among them NaNs.
    pub(crate) fn new(rows: &[Row], capacity: usize, next_id: u32, random: &mut Random) -> Self {
        assert!(rows.len() <= capacity && capacity > 0);
        let mut plane = |width: usize, take: &dyn Fn(&Row) -> Vec<u32>| -> Vec<u32> {
            let mut words: Vec<u32> = rows.iter().flat_map(take).collect();
            assert_eq!(words.len(), width * rows.len());
            while words.len() < width * capacity {
                words.push(if below(random, 3) == 0 { f32::NAN.to_bits() } else { random.word() });
            }
            words
        };
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<u32>>();
        let mut counters = [0; counters::COUNT];
        counters[counters::SPLATS] = rows.len() as u32;
        counters[counters::NEXT_ID] = next_id;
        Self {
            capacity,
            planes: std::array::from_fn(|p| plane(WIDTHS[p], &|r| bits(&r.planes[p]))),
            moments: std::array::from_fn(|p| plane(WIDTHS[p % 8], &|r| bits(&r.moments[p]))),
            stats: plane(4, &|r| bits(&r.stats)),
            scores: plane(2, &|r| bits(&r.scores)),
            ids: plane(1, &|r| vec![r.id]),
            counters,
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.counters[counters::SPLATS] as usize
    }

    /// The rows in use.
    pub(crate) fn rows(&self) -> Vec<Row> {
        let cut = |words: &[u32], width: usize, i: usize| -> Vec<f32> {
            words[width * i..width * (i + 1)].iter().map(|&w| f32::from_bits(w)).collect()
        };
        (0..self.len())
            .map(|i| Row {
                planes: std::array::from_fn(|p| cut(&self.planes[p], WIDTHS[p], i)),
                moments: std::array::from_fn(|p| cut(&self.moments[p], WIDTHS[p % 8], i)),
                stats: std::array::from_fn(|k| f32::from_bits(self.stats[4 * i + k])),
                scores: std::array::from_fn(|k| f32::from_bits(self.scores[2 * i + k])),
                id: self.ids[i],
            })
            .collect()
    }
}
