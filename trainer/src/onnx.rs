//! Actors as ONNX models.
//!
//! # Source
//! `onnx.proto` (field numbers) and the operators Gemm, Relu and Tanh of the default domain.

use crate::network::Network;
use firmware::form::OutputForm;
use prost::Message as _;

/// Version of the file format, and of the operators: those of ONNX 1.16, which runtimes of today know.
const IR_VERSION: i64 = 10;
const OPERATORS: i64 = 21;

/// `TensorProto.FLOAT`.
const FLOAT: i32 = 1;

/// `AttributeProto.INT`.
const INTEGER: i32 = 2;

#[derive(prost::Message)]
struct Model {
    #[prost(int64, tag = "1")]
    ir_version: i64,
    #[prost(string, tag = "2")]
    producer_name: String,
    #[prost(message, optional, tag = "7")]
    graph: Option<Graph>,
    #[prost(message, repeated, tag = "8")]
    opset_import: Vec<OperatorSet>,
}

#[derive(prost::Message)]
struct OperatorSet {
    #[prost(string, tag = "1")]
    domain: String,
    #[prost(int64, tag = "2")]
    version: i64,
}

#[derive(prost::Message)]
struct Graph {
    #[prost(message, repeated, tag = "1")]
    node: Vec<Node>,
    #[prost(string, tag = "2")]
    name: String,
    #[prost(message, repeated, tag = "5")]
    initializer: Vec<Tensor>,
    #[prost(message, repeated, tag = "11")]
    input: Vec<ValueInfo>,
    #[prost(message, repeated, tag = "12")]
    output: Vec<ValueInfo>,
}

#[derive(prost::Message)]
struct Node {
    #[prost(string, repeated, tag = "1")]
    input: Vec<String>,
    #[prost(string, repeated, tag = "2")]
    output: Vec<String>,
    #[prost(string, tag = "3")]
    name: String,
    #[prost(string, tag = "4")]
    op_type: String,
    #[prost(message, repeated, tag = "5")]
    attribute: Vec<Attribute>,
}

#[derive(prost::Message)]
struct Attribute {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(int64, tag = "3")]
    i: i64,
    #[prost(int32, tag = "20")]
    kind: i32,
}

#[derive(prost::Message)]
struct Tensor {
    #[prost(int64, repeated, tag = "1")]
    dims: Vec<i64>,
    #[prost(int32, tag = "2")]
    data_type: i32,
    #[prost(string, tag = "8")]
    name: String,
    #[prost(bytes = "vec", tag = "9")]
    raw_data: Vec<u8>,
}

#[derive(prost::Message)]
struct ValueInfo {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, optional, tag = "2")]
    kind: Option<Kind>,
}

#[derive(prost::Message)]
struct Kind {
    #[prost(message, optional, tag = "1")]
    tensor: Option<TensorKind>,
}

#[derive(prost::Message)]
struct TensorKind {
    #[prost(int32, tag = "1")]
    element: i32,
    #[prost(message, optional, tag = "2")]
    shape: Option<Shape>,
}

#[derive(prost::Message)]
struct Shape {
    #[prost(message, repeated, tag = "1")]
    dim: Vec<Dimension>,
}

#[derive(prost::Message)]
struct Dimension {
    #[prost(oneof = "Length", tags = "1, 2")]
    length: Option<Length>,
}

#[derive(prost::Oneof)]
enum Length {
    #[prost(int64, tag = "1")]
    Value(i64),
    #[prost(string, tag = "2")]
    Parameter(String),
}

/// One actor as a model: input `observation` of `[batch, inputs]`; output `scores`, or `action` after tanh where the form says
/// so, of `[batch, outputs]`. Weights have the names and shapes of the safetensors file.
pub fn model(network: &Network, form: OutputForm) -> Vec<u8> {
    let widths = network.widths();
    let mut graph = Graph {
        name: "actor".to_owned(),
        input: vec![matrix("observation", widths[0])],
        ..Graph::default()
    };
    let mut value = "observation".to_owned();
    let last = network.layers().len() - 1;
    let tanh = form == OutputForm::SubChannelAndPower;
    for (index, layer) in network.layers().enumerate() {
        let name = format!("layers.{index}");
        let (weight, bias) = (format!("{name}.weight"), format!("{name}.bias"));
        let shape = [layer.outputs as i64, layer.inputs as i64];
        graph.initializer.push(tensor(&weight, &shape, layer.weights));
        graph.initializer.push(tensor(&bias, &shape[..1], layer.biases));
        let product = if index == last && !tanh {
            "scores".to_owned()
        } else {
            name.clone()
        };
        graph.node.push(Node {
            input: vec![value, weight, bias],
            output: vec![product.clone()],
            name,
            op_type: "Gemm".to_owned(),
            attribute: vec![Attribute {
                name: "transB".to_owned(),
                i: 1,
                kind: INTEGER,
            }],
        });
        let activation = if index < last {
            Some(("Relu", format!("activations.{index}")))
        } else {
            None
        };
        let activation = activation.or_else(|| tanh.then(|| ("Tanh", "action".to_owned())));
        value = product;
        if let Some((operator, output)) = activation {
            graph.node.push(Node {
                input: vec![value],
                output: vec![output.clone()],
                name: output.clone(),
                op_type: operator.to_owned(),
                attribute: Vec::new(),
            });
            value = output;
        }
    }
    graph.output.push(matrix(&value, widths[last + 1]));
    let model = Model {
        ir_version: IR_VERSION,
        producer_name: "freshlane".to_owned(),
        graph: Some(graph),
        opset_import: vec![OperatorSet {
            domain: String::new(),
            version: OPERATORS,
        }],
    };
    model.encode_to_vec()
}

fn tensor(name: &str, dims: &[i64], values: &[f32]) -> Tensor {
    Tensor {
        dims: dims.to_vec(),
        data_type: FLOAT,
        name: name.to_owned(),
        raw_data: values.iter().flat_map(|value| value.to_le_bytes()).collect(),
    }
}

/// A matrix of floats with any number of rows.
fn matrix(name: &str, columns: usize) -> ValueInfo {
    let dimension = |length| Dimension { length: Some(length) };
    let shape = Shape {
        dim: vec![
            dimension(Length::Parameter("batch".to_owned())),
            dimension(Length::Value(columns as i64)),
        ],
    };
    ValueInfo {
        name: name.to_owned(),
        kind: Some(Kind {
            tensor: Some(TensorKind {
                element: FLOAT,
                shape: Some(shape),
            }),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// onnxruntime ran this model to the right numbers; `tests/check_exports.py` runs a whole run's.
    #[test]
    fn models_have_the_bytes_that_onnxruntime_runs() {
        let network = Network::new(&[2, 1, 2], vec![1.0, -2.0, 0.5, 3.0, 4.0, 0.0, -1.0]);
        let bytes = model(&network, OutputForm::Actions);
        let hexadecimal: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        let expected = [
            "080a120966726573686c616e653aac030a560a0b6f62736572766174696f6e0a0f6c61796572732e302e776569676874",
            "0a0d6c61796572732e302e6269617312086c61796572732e301a086c61796572732e30220447656d6d2a0d0a06747261",
            "6e73421801a001020a2e0a086c61796572732e30120d61637469766174696f6e732e301a0d61637469766174696f6e73",
            "2e30220452656c750a560a0d61637469766174696f6e732e300a0f6c61796572732e312e7765696768740a0d6c617965",
            "72732e312e62696173120673636f7265731a086c61796572732e31220447656d6d2a0d0a067472616e73421801a00102",
            "12056163746f722a210a0201021001420f6c61796572732e302e7765696768744a080000803f000000c02a1a0a010110",
            "01420d6c61796572732e302e626961734a040000003f2a210a0202011001420f6c61796572732e312e7765696768744a",
            "0800004040000080402a1e0a01021001420d6c61796572732e312e626961734a0800000000000080bf5a220a0b6f6273",
            "6572766174696f6e12130a110801120d0a07120562617463680a020802621d0a0673636f72657312130a110801120d0a",
            "07120562617463680a02080242021015",
        ];
        assert_eq!(hexadecimal, expected.concat());

        let continuous = model(&network, OutputForm::SubChannelAndPower);
        let graph = Model::decode(continuous.as_slice()).unwrap().graph.unwrap();
        let operators: Vec<&str> = graph.node.iter().map(|node| node.op_type.as_str()).collect();
        assert_eq!(operators, ["Gemm", "Relu", "Gemm", "Tanh"]);
        assert_eq!(
            (&graph.node[3].output[0], &graph.output[0].name),
            (&"action".to_owned(), &"action".to_owned())
        );
        assert_eq!(graph.node[3].input, graph.node[2].output);
    }
}
