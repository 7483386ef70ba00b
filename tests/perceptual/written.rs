//! Files of weights in each format, written byte by byte.

use std::io::Write;

use psrgs_vk::perceptual::Tensor;

/// Arrays by name.
pub type Arrays = [(String, Tensor)];

fn int(out: &mut Vec<u8>, value: usize) {
    out.push(b'J');
    out.extend((value as u32).to_le_bytes());
}

fn text(out: &mut Vec<u8>, text: &str) {
    out.push(b'X');
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(text.as_bytes());
}

/// A tuple of whole numbers.
fn tuple(out: &mut Vec<u8>, values: &[usize]) {
    out.push(b'(');
    values.iter().for_each(|v| int(out, *v));
    out.push(b't');
}

/// The pickle of a dictionary of tensors, each in a storage of its own, whose key is the index of the tensor.
/// `parameters` wraps each tensor in a parameter.
fn pickle(arrays: &Arrays, parameters: bool) -> Vec<u8> {
    let mut out = b"\x80\x02}(".to_vec();
    for (key, (name, tensor)) in arrays.iter().enumerate() {
        text(&mut out, name);
        if parameters {
            out.extend(b"ctorch._utils\n_rebuild_parameter\n(");
        }
        out.extend(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        text(&mut out, "storage");
        out.extend(b"ctorch\nFloatStorage\n");
        text(&mut out, &key.to_string());
        text(&mut out, "cpu");
        int(&mut out, tensor.values.len());
        out.extend(b"tQK\x00");
        tuple(&mut out, &tensor.shape);
        let strides: Vec<usize> = (0..tensor.shape.len()).map(|k| tensor.shape[k + 1..].iter().product()).collect();
        tuple(&mut out, &strides);
        out.extend(b"\x89ccollections\nOrderedDict\n)RtR");
        if parameters {
            out.extend(b"\x88ccollections\nOrderedDict\n)RtR");
        }
    }
    out.extend(b"u.");
    out
}

fn numbers(tensor: &Tensor) -> Vec<u8> {
    tensor.values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// PyTorch's old form.
pub fn old_pth(arrays: &Arrays) -> Vec<u8> {
    let mut out = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.\x80\x02M\xe9\x03.\x80\x02}.".to_vec();
    out.extend(pickle(arrays, true));
    out.extend(b"\x80\x02](");
    (0..arrays.len()).for_each(|key| text(&mut out, &key.to_string()));
    out.extend(b"e.");
    for (_, tensor) in arrays {
        out.extend((tensor.values.len() as u64).to_le_bytes());
        out.extend(numbers(tensor));
    }
    out
}

/// PyTorch's form in a zip archive.
pub fn zip_pth(arrays: &Arrays) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let mut add = |name: &str, bytes: &[u8]| {
        archive.start_file(name, stored).unwrap();
        archive.write_all(bytes).unwrap();
    };
    add("model/data.pkl", &pickle(arrays, false));
    add("model/version", b"3\n");
    for (key, (_, tensor)) in arrays.iter().enumerate() {
        add(&format!("model/data/{key}"), &numbers(tensor));
    }
    archive.finish().unwrap().into_inner()
}

/// `.safetensors`.
pub fn safetensors(arrays: &Arrays) -> Vec<u8> {
    let mut header = serde_json::Map::new();
    let mut data = Vec::new();
    for (name, tensor) in arrays {
        let begin = data.len();
        data.extend(numbers(tensor));
        let entry = serde_json::json!({ "dtype": "F32", "shape": tensor.shape, "data_offsets": [begin, data.len()] });
        header.insert(name.clone(), entry);
    }
    let header = serde_json::Value::Object(header).to_string();
    let mut out = (header.len() as u64).to_le_bytes().to_vec();
    out.extend(header.as_bytes());
    out.extend(data);
    out
}

/// ncnn's `.param` and `.bin`: filters in 16 bits, the classifier as zeros.
pub fn ncnn(arrays: &Arrays) -> (String, Vec<u8>) {
    let classes = 10;
    let classifier = [
        (
            "classifier.1.weight".to_owned(),
            Tensor { shape: vec![classes, 512, 1, 1], values: vec![0.0; classes * 512] },
        ),
        ("classifier.1.bias".to_owned(), Tensor { shape: vec![classes], values: vec![0.0; classes] }),
    ];
    let all: Vec<&(String, Tensor)> = arrays.iter().chain(&classifier).collect();
    let (mut param, mut bin) = ("7767517\n40 50\nInput in0 0 1 in0\n".to_owned(), Vec::new());
    for pair in all.chunks(2) {
        let [(name, filters), (_, biases)] = pair else { panic!() };
        let (outputs, size, count) = (filters.shape[0], filters.shape[2], filters.values.len());
        param += &format!("Convolution {name} 1 1 x {name}_out 0={outputs} 1={size} 11={size} 5=1 6={count} 9=1\n");
        if let Some(fire) = name.strip_suffix(".expand3x3.weight") {
            param += &format!("Concat cat 2 1 {fire}.expand1x1.weight_out {name}_out joined 0=0\n");
        }
        bin.extend(0x0130_6B47u32.to_le_bytes());
        bin.extend(filters.values.iter().flat_map(|v| half::f16::from_f32(*v).to_le_bytes()));
        bin.resize(bin.len().next_multiple_of(4), 0);
        bin.extend(numbers(biases));
    }
    (param, bin)
}
