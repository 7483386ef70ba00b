//! The variants of the passes that a training runs with.

use crate::raster::{GradientSum, NamedVariants, Variants};
use crate::train::Error;
use crate::train::settings::Settings;
use crate::vk::{FloatAtomics, Gpu};

/// The parts of the variants that the settings name.
pub(super) fn named(settings: &Settings) -> NamedVariants {
    let (blending, stepping) = (&settings.blending, &settings.stepping);
    NamedVariants {
        tile: blending.tile_shape,
        gradients: stepping.gradient_sum,
        lists: blending.list_sort,
        chunks: blending.chunks,
    }
}

impl Settings {
    /// Names every part of the variants.
    pub fn name_variants(&mut self, variants: Variants) {
        self.blending.tile_shape = Some(variants.tile);
        self.blending.list_sort = Some(variants.lists);
        self.blending.chunks = Some(variants.chunks);
        self.stepping.gradient_sum = Some(variants.gradients);
    }
}

/// The variants that the settings name, completed by those that suit the device.
pub fn chosen_variants(gpu: &Gpu, settings: &Settings) -> Result<Variants, Error> {
    let run = &settings.run;
    let named = named(settings);
    let variants = Variants::choose(gpu, run.deterministic).with(gpu, named);
    // The gradient sum that suits the device may not exist for the tile shape of the settings; slots exist for all.
    let slots = Variants { gradients: GradientSum::Slots, ..variants };
    let variants = match named.gradients {
        None if !variants.runs_on(gpu) && slots.runs_on(gpu) => slots,
        _ => variants,
    };
    if run.deterministic && variants.gradients != GradientSum::Slots {
        return Err(Error::NotDeterministic);
    }
    if variants.gradients == GradientSum::Atomic && gpu.caps().buffer_floats != FloatAtomics::Native {
        return Err(Error::NoFloatAtomics);
    }
    if !variants.fits(gpu) {
        let most = gpu.caps().limits.shared_bytes;
        return Err(Error::SharedMemory { form: variants.to_string(), most });
    }
    Ok(variants)
}
