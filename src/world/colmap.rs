//! Writes a COLMAP sparse model in its binary format (documented at colmap.github.io, "Output format").

use std::io::{self, Write};

use glam::{DMat3, DQuat, DVec3};

use super::{TiePoint, WorldView};
use crate::dataset::lens::Lens;
use crate::scene::Camera;

const PINHOLE: i32 = 1;
const OPENCV: i32 = 4;

/// `cameras.bin` with one camera, number 1: OPENCV with the coefficients k1, k2, p1, p2 where there is a lens, else
/// PINHOLE.
pub(super) fn write_camera(out: &mut dyn Write, camera: &Camera, lens: Option<(&Lens, [f64; 4])>) -> io::Result<()> {
    out.write_all(&1u64.to_le_bytes())?;
    out.write_all(&1u32.to_le_bytes())?;
    let (model, size) = lens.map_or((PINHOLE, [camera.width, camera.height]), |(lens, _)| (OPENCV, lens.size));
    out.write_all(&model.to_le_bytes())?;
    size.iter().try_for_each(|side| out.write_all(&u64::from(*side).to_le_bytes()))?;
    match lens {
        None => floats(out, &[camera.fx, camera.fy, camera.cx, camera.cy]),
        Some((lens, coefficients)) => {
            floats(out, &lens.focal)?;
            floats(out, &lens.center)?;
            floats(out, &coefficients)
        }
    }
}

/// `images.bin`: view k is image k + 1, with its reconstructed pose. Observations follow the order of the points.
pub(super) fn write_images(out: &mut dyn Write, views: &[WorldView], points: &[TiePoint]) -> io::Result<()> {
    let mut seen = vec![Vec::new(); views.len()];
    for (number, point) in points.iter().enumerate() {
        for &(view, pixel) in &point.track {
            seen[view as usize].push((pixel, number as u64 + 1));
        }
    }
    out.write_all(&(views.len() as u64).to_le_bytes())?;
    for (k, (view, seen)) in views.iter().zip(seen).enumerate() {
        let rows = view.reconstructed.rotation.map(DVec3::from_array);
        let q = DQuat::from_mat3(&DMat3::from_cols(rows[0], rows[1], rows[2]).transpose());
        out.write_all(&(k as u32 + 1).to_le_bytes())?;
        floats(out, &[q.w, q.x, q.y, q.z])?;
        floats(out, &view.reconstructed.translation)?;
        out.write_all(&1u32.to_le_bytes())?;
        out.write_all(view.name.as_bytes())?;
        out.write_all(&[0])?;
        out.write_all(&(seen.len() as u64).to_le_bytes())?;
        for (pixel, point) in seen {
            floats(out, &pixel)?;
            out.write_all(&point.to_le_bytes())?;
        }
    }
    Ok(())
}

/// `points3D.bin`: point k is number k + 1.
pub(super) fn write_points(out: &mut dyn Write, views: usize, points: &[TiePoint]) -> io::Result<()> {
    let mut next = vec![0u32; views];
    out.write_all(&(points.len() as u64).to_le_bytes())?;
    for (number, point) in points.iter().enumerate() {
        out.write_all(&(number as u64 + 1).to_le_bytes())?;
        floats(out, &point.position)?;
        out.write_all(&point.colour)?;
        floats(out, &[point.error])?;
        out.write_all(&(point.track.len() as u64).to_le_bytes())?;
        for &(view, _) in &point.track {
            let slot = &mut next[view as usize];
            out.write_all(&(view + 1).to_le_bytes())?;
            out.write_all(&slot.to_le_bytes())?;
            *slot += 1;
        }
    }
    Ok(())
}

fn floats(out: &mut dyn Write, values: &[f64]) -> io::Result<()> {
    values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}
