// The names that pickles of numbers use. Whatever is not here is refused: nothing in a file is run.
#include "engine/io/pickles/pickle_graph.h"

namespace doppel::pickle {

namespace {

struct KnownName {
    const char* name;
    Name meaning;
};

constexpr KnownName kKnownNames[] = {
    {"numpy.core.multiarray._reconstruct", Name::reconstruct},
    {"numpy._core.multiarray._reconstruct", Name::reconstruct},
    {"numpy.core.multiarray.scalar", Name::scalar},
    {"numpy._core.multiarray.scalar", Name::scalar},
    {"numpy.core.numeric._frombuffer", Name::fromBuffer},
    {"numpy._core.numeric._frombuffer", Name::fromBuffer},
    {"numpy.ndarray", Name::ndarray},
    {"numpy.dtype", Name::dtype},
    {"_codecs.encode", Name::encode},
    {"copy_reg._reconstructor", Name::reconstructor},
    {"copyreg._reconstructor", Name::reconstructor},
    {"__builtin__.object", Name::baseObject},
    {"builtins.object", Name::baseObject},
    {"collections.OrderedDict", Name::orderedDict},
    {"collections.defaultdict", Name::defaultDict},
    {"__builtin__.set", Name::setType},
    {"builtins.set", Name::setType},
    {"__builtin__.frozenset", Name::setType},
    {"builtins.frozenset", Name::setType},
    {"__builtin__.bytes", Name::bytesType},
    {"builtins.bytes", Name::bytesType},
    {"__builtin__.bytearray", Name::bytesType},
    {"builtins.bytearray", Name::bytesType},
    {"__builtin__.list", Name::plainType},
    {"builtins.list", Name::plainType},
    {"__builtin__.dict", Name::plainType},
    {"builtins.dict", Name::plainType},
    {"__builtin__.int", Name::plainType},
    {"builtins.int", Name::plainType},
    {"__builtin__.float", Name::plainType},
    {"builtins.float", Name::plainType},
    {"chumpy.ch.Ch", Name::chumpy},
    {"chumpy.reordering.Select", Name::chumpySelect},
    {"scipy.sparse.csc.csc_matrix", Name::csc},
    {"scipy.sparse._csc.csc_matrix", Name::csc},
    {"scipy.sparse._csc.csc_array", Name::csc},
    {"scipy.sparse.csr.csr_matrix", Name::csr},
    {"scipy.sparse._csr.csr_matrix", Name::csr},
    {"scipy.sparse._csr.csr_array", Name::csr},
    {"scipy.sparse.coo.coo_matrix", Name::coo},
    {"scipy.sparse._coo.coo_matrix", Name::coo},
    {"scipy.sparse._coo.coo_array", Name::coo},
    {"joblib.numpy_pickle.NumpyArrayWrapper", Name::joblibArray},
};

// In PyTorch files only.
constexpr KnownName kTorchNames[] = {
    {"torch._utils._rebuild_tensor", Name::torchTensor},
    {"torch._utils._rebuild_tensor_v2", Name::torchTensor},
    {"torch._utils._rebuild_parameter", Name::torchParameter},
    {"torch.FloatStorage", Name::torchStorage},
    {"torch.DoubleStorage", Name::torchStorage},
    {"torch.HalfStorage", Name::torchStorage},
    {"torch.BFloat16Storage", Name::torchStorage},
    {"torch.LongStorage", Name::torchStorage},
    {"torch.IntStorage", Name::torchStorage},
    {"torch.ShortStorage", Name::torchStorage},
    {"torch.CharStorage", Name::torchStorage},
    {"torch.ByteStorage", Name::torchStorage},
    {"torch.BoolStorage", Name::torchStorage},
};

}  // namespace

std::optional<Name> knownName(std::string_view name, bool torch) {
    for (const KnownName& known : kKnownNames)
        if (name == known.name) return known.meaning;
    for (const KnownName& known : kTorchNames)
        if (torch && name == known.name) return known.meaning;
    return std::nullopt;
}

bool makesObjects(Name name) {
    return name == Name::chumpy || name == Name::chumpySelect || name == Name::csc ||
           name == Name::csr || name == Name::coo || name == Name::joblibArray;
}

const char* kindName(const Node& node) {
    switch (node.kind) {
        case PickleValue::Kind::none:
            return "None";
        case PickleValue::Kind::boolean:
            return "a truth value";
        case PickleValue::Kind::integer:
            return "an integer";
        case PickleValue::Kind::real:
            return "a number";
        case PickleValue::Kind::text:
            return "text";
        case PickleValue::Kind::bytes:
            return "bytes";
        case PickleValue::Kind::list:
            return "a list";
        case PickleValue::Kind::tuple:
            return "a tuple";
        case PickleValue::Kind::set:
            return "a set";
        case PickleValue::Kind::dict:
            return "a dict";
        case PickleValue::Kind::array:
            return "an array";
        case PickleValue::Kind::object:
            return "an object";
    }
    return "something";
}

}  // namespace doppel::pickle
