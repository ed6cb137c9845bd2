"""Makes the PyTorch files beside it: honest ones, and ones that lie. Needs torch 1.13 or later."""
import torch, zipfile, io, os, pickle, struct
O = os.path.dirname(os.path.abspath(__file__)) + '/'
from collections import OrderedDict
base=torch.arange(24,dtype=torch.float32)
sd=OrderedDict([('layer.weight',base.view(2,3,4)*.5-1),('layer.bias',torch.tensor([1.5,-2.0])),
 ('transposed',base.view(4,6).t()),('part',base.view(4,6)[1:3,2:5]),('half',torch.tensor([.5,-65504.0]).half()),('brain',torch.tensor([1.5,-3.0]).bfloat16()),
 ('double',torch.tensor([1e-3,2.0],dtype=torch.float64)),('scalar',torch.tensor(7.0)),('empty',torch.zeros(0,4)),('num_batches_tracked',torch.tensor(3)),('parameter',torch.nn.Parameter(torch.tensor([4.0])))])
torch.save(sd,O+'state_dict.pt')
torch.save(sd,O+'legacy.pt',_use_new_zipfile_serialization=False)
torch.save({'epoch':3,'state_dict':OrderedDict([('w',torch.tensor([1.0,2.0]))]),'args':['a']},O+'checkpoint.pt')
def edit(name,f):
    z=zipfile.ZipFile(O+'state_dict.pt'); out=zipfile.ZipFile(O+name,'w',zipfile.ZIP_STORED)
    for i in z.infolist():
        r=f(i.filename,z.read(i))
        if r is not None: 
            zi=zipfile.ZipInfo(i.filename,(1980,1,1,0,0,0)); out.writestr(zi,r)
    out.close()
P='data.pkl'
class Evil:
    def __reduce__(self): return (os.system,('touch was-here',))
edit('code.pt',lambda n,b: pickle.dumps({'w':Evil()},2) if n.endswith(P) else b)
edit('missing_storage.pt',lambda n,b: None if n.endswith('data/0') else b)
edit('short_storage.pt',lambda n,b: b[:8] if n.endswith('data/0') else b)
edit('no_pickle.pt',lambda n,b: None if n.endswith(P) else b)
edit('big_endian.pt',lambda n,b: b)
z=zipfile.ZipFile(O+'big_endian.pt','a'); z.writestr(zipfile.ZipInfo('state_dict/byteorder',(1980,1,1,0,0,0)),b'big'); z.close()
class M(torch.nn.Module):
    def forward(self,x): return x
torch.jit.save(torch.jit.script(M()),O+'torchscript.pt')
# hand-written pickles: shapes that lie
def tensor(numel,offset,size,stride,key='0'):
    b=b'ctorch._utils\n_rebuild_tensor_v2\n('
    b+=b'(X\x07\x00\x00\x00storagectorch\nFloatStorage\nX\x01\x00\x00\x00'+key.encode()+b'X\x03\x00\x00\x00cpu'+b'\x8a\x08'+struct.pack('<q',numel)+b'tQ'
    b+=b'\x8a\x08'+struct.pack('<q',offset)
    for t in (size,stride): b+=b'('+b''.join(b'\x8a\x08'+struct.pack('<q',v) for v in t)+b't'
    return b+b'\x89}tR'
def dict_(*ts): return b'\x80\x02}('+b''.join(b'X\x01\x00\x00\x00'+bytes([97+i])+t for i,t in enumerate(ts))+b'u.'
for name,p in {'beyond_storage':dict_(tensor(24,20,[5],[1])),'overflow':dict_(tensor(24,0,[2**40,2**40],[1,1])),'negative':dict_(tensor(24,-1,[2],[1])),
  'bomb':dict_(tensor(24,0,[2**20,2**10],[0,0])),'many':dict_(*[tensor(24,0,[2000],[0]) for _ in range(25)]),'huge_storage':dict_(tensor(2**60,0,[2],[1]))}.items():
    edit(name+'.pt',lambda n,b: p if n.endswith(P) else b)
