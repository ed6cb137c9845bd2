"""Makes lpips.npz and inception3d.npz: LPIPS and Inception-3D on random weights, a hash of their
names, in float64. Needs torch and torchvision.
"""
import numpy as np, torch, torch.nn as nn, torch.nn.functional as F, torchvision, zlib, os
torch.set_default_dtype(torch.float64)
OUT = os.path.dirname(os.path.abspath(__file__)) + '/'
def uniform(name,n):
    i=np.arange(n,dtype=np.uint32)
    with np.errstate(over='ignore'):
        x=np.uint32(zlib.crc32(name.encode()))+i*np.uint32(2654435761)
        x^=x>>np.uint32(16); x*=np.uint32(0x85ebca6b); x^=x>>np.uint32(13); x*=np.uint32(0xc2b2ae35); x^=x>>np.uint32(16)
    return x.astype(np.float64)/2**32
def tensor(name,shape):
    n=int(np.prod(shape)); u=uniform(name,n)
    if name.endswith('running_var') or (name.endswith('bn.weight')): v=.5+u
    elif name.startswith('lin'): v=u
    elif len(shape)>1: v=(2*u-1)*np.sqrt(6/np.prod(shape[1:]))
    else: v=.2*(2*u-1)
    return torch.tensor(v.astype(np.float32).astype(np.float64).reshape(shape))
def fill(sd): return {k:(tensor(k,tuple(v.shape)) if v.is_floating_point() else v) for k,v in sd.items()}
def image(name,h,w):
    base=uniform(name,h*w*3).astype(np.float32).astype(np.float64).reshape(h,w,3); return base
nets={'alex':(torchvision.models.alexnet,[2,5,8,10,12],[64,192,384,256,256]),
 'vgg':(torchvision.models.vgg16,[4,9,16,23,30],[64,128,256,512,512]),
 'squeeze':(torchvision.models.squeezenet1_1,[2,5,8,10,11,12,13],[64,128,256,384,384,512,512])}
shift=torch.tensor([-.030,-.088,-.188]).view(1,3,1,1); scale=torch.tensor([.458,.448,.450]).view(1,3,1,1)
out={}
H,W=53,46
a=image('a',H,W); b=.7*a+.3*image('b',H,W)
b=b.astype(np.float32).astype(np.float64)
for n,(ctor,ends,ch) in nets.items():
    m=ctor(weights=None).double().eval(); f=m.features
    sd={k:tensor(k,tuple(v.shape)) for k,v in m.state_dict().items() if k.startswith('features')}
    m.load_state_dict({**m.state_dict(),**sd})
    if n in('alex','vgg','squeeze'):
        for l in f.modules():
            if isinstance(l,nn.ReLU): l.inplace=False
    pre=lambda x:(2*torch.tensor(x).permute(2,0,1)[None]-1-shift)/scale
    with torch.no_grad():
        xa,xb=pre(a),pre(b); total=0; layers=[]; start=0
        for k,e in enumerate(ends):
            xa,xb=f[start:e](xa),f[start:e](xb); start=e
            assert xa.shape[1]==ch[k],(n,k,xa.shape)
            na=xa/(xa.pow(2).sum(1,keepdim=True).sqrt()+1e-10); nb=xb/(xb.pow(2).sum(1,keepdim=True).sqrt()+1e-10)
            w=tensor(f'lin{k}',(1,ch[k],1,1))
            layers.append(float(((na-nb)**2*w).sum(1).mean())); total+=layers[-1]
    print(n,total,layers); out[n]=np.float64(total)
np.savez_compressed(OUT+'lpips.npz',height=np.int64(H),width=np.int64(W),**out)

class Unit(nn.Module):
    def __init__(s,i,o,k,st=(1,1,1),bn=True,bias=False):
        super().__init__(); s.k=k; s.st=st; s.conv3d=nn.Conv3d(i,o,k,st,bias=bias)
        s.usebn=bn
        if bn: s.bn=nn.BatchNorm3d(o,eps=1e-3)
    def forward(s,x):
        p=[]
        for d in (4,3,2):
            n=x.shape[d];K=s.k[d-2];S=s.st[d-2];t=max(K-S,0) if n%S==0 else max(K-n%S,0); p+=[t//2,t-t//2]
        x=s.conv3d(F.pad(x,p))
        return F.relu(s.bn(x)) if s.usebn else x
def pool(x,k,st):
    p=[]
    for d in (4,3,2):
        n=x.shape[d];K=k[d-2];S=st[d-2];t=max(K-S,0) if n%S==0 else max(K-n%S,0); p+=[t//2,t-t//2]
    return F.max_pool3d(F.pad(x,p),k,st)
class Mixed(nn.Module):
    def __init__(s,i,o):
        super().__init__()
        s.b0=Unit(i,o[0],(1,1,1));s.b1a=Unit(i,o[1],(1,1,1));s.b1b=Unit(o[1],o[2],(3,3,3));s.b2a=Unit(i,o[3],(1,1,1));s.b2b=Unit(o[3],o[4],(3,3,3));s.b3b=Unit(i,o[5],(1,1,1))
    def forward(s,x): return torch.cat([s.b0(x),s.b1b(s.b1a(x)),s.b2b(s.b2a(x)),s.b3b(pool(x,(3,3,3),(1,1,1)))],1)
class I3D(nn.Module):
    def __init__(s,classes):
        super().__init__()
        s.Conv3d_1a_7x7=Unit(3,64,(7,7,7),(2,2,2));s.Conv3d_2b_1x1=Unit(64,64,(1,1,1));s.Conv3d_2c_3x3=Unit(64,192,(3,3,3))
        spec={'3b':(192,[64,96,128,16,32,32]),'3c':(256,[128,128,192,32,96,64]),'4b':(480,[192,96,208,16,48,64]),'4c':(512,[160,112,224,24,64,64]),'4d':(512,[128,128,256,24,64,64]),'4e':(512,[112,144,288,32,64,64]),'4f':(528,[256,160,320,32,128,128]),'5b':(832,[256,160,320,32,128,128]),'5c':(832,[384,192,384,48,128,128])}
        for n,(i,o) in spec.items(): setattr(s,'Mixed_'+n,Mixed(i,o))
        s.logits=Unit(1024,classes,(1,1,1),bn=False,bias=True)
    def forward(s,x):
        x=pool(s.Conv3d_1a_7x7(x),(1,3,3),(1,2,2)); x=pool(s.Conv3d_2c_3x3(s.Conv3d_2b_1x1(x)),(1,3,3),(1,2,2))
        x=pool(s.Mixed_3c(s.Mixed_3b(x)),(3,3,3),(2,2,2))
        for n in 'bcdef': x=getattr(s,'Mixed_4'+n)(x)
        x=pool(x,(2,2,2),(2,2,2)); x=s.Mixed_5c(s.Mixed_5b(x))
        print(x.shape)
        return s.logits(x.mean((2,3,4),keepdim=True)).flatten(1)
m=I3D(7).eval(); m.load_state_dict(fill(m.state_dict()))
T,h,w=16,40,52
v=(2*uniform('video',T*3*h*w).astype(np.float32).astype(np.float64)-1).astype(np.float32).astype(np.float64).reshape(T,3,h,w)
with torch.no_grad(): y=m(torch.tensor(v).permute(1,0,2,3)[None])
print(y); np.savez_compressed(OUT+'inception3d.npz',height=np.int64(h),width=np.int64(w),frames=np.int64(T),logits=y.numpy()[0])
