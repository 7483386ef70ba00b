//! Which splats of a model are written.

use crate::format::ply::Model;
use crate::scene::Similarity;

/// A choice of splats. By default all are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Choice {
    /// Least and largest x, y, z of the box in which the centres of the splats lie, in dataset coordinates.
    pub within: Option<([f64; 3], [f64; 3])>,
    /// Least opacity, from 0 to 1.
    pub least_opacity: f64,
    /// Most splats. Those that cover most of pictures are kept: the largest products of opacity and area.
    pub most: Option<usize>,
}

impl Choice {
    /// The model with the chosen splats, in their order. `to_dataset` leads to dataset coordinates from those of the
    /// model, [`Model::shift`] added to means.
    pub fn of(&self, model: &Model, to_dataset: &Similarity) -> Model {
        let g = &model.gaussians;
        let opacity = |i: usize| 1.0 / (1.0 + (-f64::from(g.opacities[i])).exp());
        let inside = |i: usize| {
            self.within.is_none_or(|(low, high)| {
                let at = to_dataset.point(std::array::from_fn(|k| f64::from(g.means[3 * i + k]) + model.shift[k]));
                (0..3).all(|k| low[k] <= at[k] && at[k] <= high[k])
            })
        };
        let mut rows: Vec<u32> =
            (0..g.len()).filter(|i| opacity(*i) >= self.least_opacity && inside(*i)).map(|i| i as u32).collect();
        if let Some(most) = self.most.filter(|most| *most < rows.len()) {
            // The area of an ellipsoid is near that of its two longer axes.
            let weight = |i: u32| {
                let axes = &g.scales[3 * i as usize..3 * i as usize + 3];
                let sum: f64 = axes.iter().map(|s| f64::from(*s)).sum();
                let shortest = axes.iter().fold(f64::INFINITY, |least, s| least.min(f64::from(*s)));
                opacity(i as usize) * (sum - shortest).exp()
            };
            rows.sort_by(|a, b| weight(*b).total_cmp(&weight(*a)));
            rows.truncate(most);
            rows.sort_unstable();
        }
        model.rows(&rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Gaussians;

    #[test]
    fn splats_are_chosen_by_place_opacity_and_weight() {
        let mut g = Gaussians::zeros(4);
        for i in 0..4 {
            g.means[3 * i] = i as f32;
            g.opacities[i] = i as f32 - 1.0;
        }
        g.scales[0..3].fill(3.0);
        let model = Model { gaussians: g, shift: [1e6, 0.0, 0.0], constrained: Some(2), ..Model::default() };
        let kept = |choice: Choice| choice.of(&model, &Similarity::IDENTITY);
        assert_eq!(kept(Choice::default()), model);
        let within = Some(([1e6 + 0.5, -1.0, -1.0], [1e6 + 2.0, 1.0, 1.0]));
        let inside = kept(Choice { within, ..Choice::default() });
        assert_eq!((inside.gaussians.means[0], inside.gaussians.len(), inside.constrained), (1.0, 2, Some(1)));
        let halved = Similarity { scale: 0.5, ..Similarity::IDENTITY };
        let within = Some(([0.5e6 + 0.7, -1.0, -1.0], [0.5e6 + 1.2, 1.0, 1.0]));
        let of_halves = Choice { within, ..Choice::default() }.of(&model, &halved);
        assert_eq!((of_halves.gaussians.means[0], of_halves.gaussians.len()), (2.0, 1), "1.0 of the dataset's units");
        let opaque = kept(Choice { least_opacity: 0.5, ..Choice::default() });
        assert_eq!((opaque.gaussians.opacities.as_slice(), opaque.constrained), (&[0.0, 1.0, 2.0][..], Some(1)));
        let large = kept(Choice { most: Some(2), ..Choice::default() });
        assert_eq!(large.gaussians.opacities, [-1.0, 2.0], "the wide one and the most opaque one, in their order");
        assert_eq!(large.gaussians.ids, [0, 1]);
    }
}
