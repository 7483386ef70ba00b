//! A hillshade: how bright a surface is under a light from the north-west, 45 degrees high (Horn 1981).

/// Brightness from 1 to 255 of the middle of 3 x 3 heights, row by row from the north-west; 0 where the middle has
/// none. Neighbours without a height count as high as the middle.
pub(super) fn brightness(heights: [f32; 9], gsd: f64) -> u8 {
    let middle = heights[4];
    if !middle.is_finite() {
        return 0;
    }
    let [a, b, c, d, _, f, g, h, i] = heights.map(|v| f64::from(if v.is_finite() { v } else { middle }));
    let east = ((c + 2.0 * f + i) - (a + 2.0 * d + g)) / (8.0 * gsd);
    let north = ((a + 2.0 * b + c) - (g + 2.0 * h + i)) / (8.0 * gsd);
    // The light comes from (-1, 1, sqrt 2) / 2; the normal is (-east, -north, 1).
    let light = (east - north + 2f64.sqrt()) / 2.0 / (1.0 + east * east + north * north).sqrt();
    (1.0 + 254.0 * light.clamp(0.0, 1.0)).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_to_the_light_are_bright() {
        let plane = |east: f32, north: f32| -> [f32; 9] {
            std::array::from_fn(|k| 7.0 + east * ((k % 3) as f32 - 1.0) - north * ((k / 3) as f32 - 1.0))
        };
        assert_eq!(brightness(plane(0.0, 0.0), 1.0), (1.0 + 254.0 * 0.5f64.sqrt()).round() as u8);
        // It falls to the north-west at 45 degrees: straight to the light.
        let steep = 0.5f32.sqrt();
        assert_eq!(brightness(plane(steep, -steep), 1.0), 255);
        assert_eq!(brightness(plane(-steep, steep), 1.0), 1, "and away from it");
        assert!(brightness(plane(steep, -steep), 4.0) < 255, "less steep over wider cells");
        let mut hole = plane(0.1, 0.1);
        hole[4] = f32::NAN;
        assert_eq!(brightness(hole, 1.0), 0);
        let mut edge = plane(0.0, 0.0);
        edge[..3].fill(f32::NAN);
        assert_eq!(brightness(edge, 1.0), brightness(plane(0.0, 0.0), 1.0));
    }
}
